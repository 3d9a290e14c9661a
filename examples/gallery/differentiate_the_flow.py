r"""
Differentiate the flow
======================

For flow-control engineers who need the gradient of drag: how drag changes with each earlier action of the jets, and
with the flow at the start of a time window. At the end you can compute both gradients of any function of sensors and
forces. The gradients are exact except for rounding, and take as long as about three runs for any number of actions.

The flow is computed while this page is built, on a coarse mesh and for a short time.
"""

# %%
# Record a window
# ---------------
# A :class:`~wake.truck.tape.Tape` advances the plant as usual and stores what the gradient needs. This window has 40
# control periods, 8 :math:`t_c`, with shut jets. It starts from the shipped wake, interpolated to this mesh.

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from rich import print

from contract.config.plant import FlowConfig
from wake.truck.develop import moved
from wake.truck.state import developed_state
from wake.truck.tape import Tape, no_weights
from wake.truck.truck_wake import TruckWake

PERIODS = 40
plant = TruckWake(FlowConfig(refinement=0.5, substeps=15))
start = moved(developed_state(), TruckWake().grid, plant, duration=4.0)
plant.reset(start)
tape = Tape(plant)
samples = [tape.advance(0.0) for _ in range(PERIODS)]
t = np.array([sample.t for sample in samples])
drag = np.array([sample.Cd for sample in samples])
print(f"{PERIODS} periods, {tape.memory_mb:.0f} MB kept, mean drag {drag.mean():.4f}")

# %%
# Compute backwards
# -----------------
# The function is the mean wall drag of the window, so ``Cd`` of each period has the weight 1 / 40. Weights may also
# apply to other values of the sample, differ between periods, or come from a controller that reads the sensors. Each
# call of ``back`` goes back by one period, and returns the derivative with respect to the action of this period.

weights = replace(no_weights(len(plant.layout)), Cd=1.0 / PERIODS)
slopes = np.array([tape.back(weights) for _ in range(PERIODS)])[::-1]
sensitivity = tape.bar.faces_u.copy()

# %%
# For one action, a finite difference of two whole runs agrees:


def mean_drag(actions: np.ndarray) -> float:
    """Return the mean drag of a run from the same start."""
    plant.reset(start)
    return float(np.mean([plant.advance(float(action)).Cd for action in actions]))


move = 1e-4 * np.eye(PERIODS)[5]
print(f"slope by action 5: {slopes[5]:+.7f}, by differences {(mean_drag(move) - mean_drag(-move)) / 2e-4:+.7f}")

# %%
# A small step against the gradient lowers the drag as much as the gradient predicts:

for largest in (0.001, 0.01, 0.04):
    actions = -largest * slopes / np.abs(slopes).max()
    promised = float(actions @ slopes)
    print(f"actions up to {largest:5.3f}: predicted {promised:+.5f}, found {mean_drag(actions) - drag.mean():+.5f}")

# %%
# Over time, and in space
# -----------------------
# The derivative oscillates with the shedding: a few periods later, the same action has the opposite effect. The map is
# the derivative of mean drag with respect to the initial streamwise velocity, per area. A higher velocity in a red
# place would have raised the drag of the next 8 :math:`t_c`; in a blue place it would have lowered this drag.

figure, (over_time, in_space) = plt.subplots(2, 1, figsize=(8, 6.5), height_ratios=(1, 1.3), layout="constrained")
over_time.plot(t - t[0], slopes, color="tab:blue", marker=".")
over_time.axhline(0.0, color="0.6", linewidth=0.8)
over_time.set(xlabel="the action's time / $t_c$", ylabel="slope of mean $C_d$ by the action")
over_time.grid(alpha=0.3)

grid = plant.grid
density = sensitivity / np.outer(grid.dxc, grid.dy)
largest = float(np.quantile(np.abs(density), 0.995))
field = in_space.pcolormesh(
    *grid.axes("u"), density.T, cmap="RdBu_r", vmin=-largest, vmax=largest, shading="nearest", rasterized=True
)
in_space.fill(
    [grid.xf[grid.front], grid.xf[grid.rear], grid.xf[grid.rear], grid.xf[grid.front]],
    [-0.5, -0.5, 0.5, 0.5],
    color="0.75",
)
in_space.set(xlim=(-2.0, 12.0), ylim=(-2.2, 2.2), aspect="equal", xlabel="x / W", ylabel="y / W")
figure.colorbar(field, ax=in_space, label="slope of mean $C_d$ by u, per area", shrink=0.6)
plt.show()

# %%
# Where to go from here
# ---------------------
# - With a controller in the loop, its reaction to a sample changes the weights of the next call of ``back``.
#   :doc:`Gradients of the flow </explanation/gradients>` has the rule, the cost, and the bound on memory.
# - In the Gymnasium environment, use ``Tape(env.unwrapped.plant)`` between two steps.
# - Small disturbances of this wake grow by a factor of about 1.2 per :math:`t_c`. Over 25 :math:`t_c` a gradient grows
#   fiftyfold and still shows how to lower the drag; over 60 :math:`t_c` it no longer predicts a real step's effect.
