r"""
Differentiate the flow
======================

For flow-control engineers who want the slope of drag, and not only drag: how much a later drag changes by each earlier
action of the jets, and by the flow that the window began with. At its end you have both, for any function of the
sensors and forces, to rounding and for the price of about three runs, however many actions there are.

The flow is computed while the page is made, on a coarse mesh and for a short time.
"""

# %%
# Record a window
# ---------------
# A :class:`~wake.truck.tape.Tape` advances the plant as usual and keeps what the way back needs. The window here is of
# 40 control periods, 8 :math:`t_c`, with the jets shut. It begins in the shipped wake, interpolated to this mesh.

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
# Go back
# -------
# The scalar is the mean wall drag of the window, so each period's sample counts with 1 / 40 of its ``Cd``. The weights
# may be anything: other values of the sample, different ones in each period, or what a controller that reads the
# sensors hands back. Each call goes back by one period and returns the slope by the action commanded in it.

weights = replace(no_weights(len(plant.layout)), Cd=1.0 / PERIODS)
slopes = np.array([tape.back(weights) for _ in range(PERIODS)])[::-1]
sensitivity = tape.bar.faces_u.copy()

# %%
# A plain difference of two whole runs, for one of the actions, agrees:


def mean_drag(actions: np.ndarray) -> float:
    """The sum of a run from the same start."""
    plant.reset(start)
    return float(np.mean([plant.advance(float(action)).Cd for action in actions]))


move = 1e-4 * np.eye(PERIODS)[5]
print(f"slope by action 5: {slopes[5]:+.7f}, by differences {(mean_drag(move) - mean_drag(-move)) / 2e-4:+.7f}")

# %%
# And a step against the slope lowers the drag by what the slope promises, while the step is small:

for largest in (0.001, 0.01, 0.04):
    actions = -largest * slopes / np.abs(slopes).max()
    promised = float(actions @ slopes)
    print(f"actions up to {largest:5.3f}: promised {promised:+.5f}, happened {mean_drag(actions) - drag.mean():+.5f}")

# %%
# Over time, and in space
# -----------------------
# The slope by an action swings with the shedding: the same jet, a few periods later, does the opposite. The map is the
# slope of the mean drag by the streamwise velocity that the window began with, per area: where a push downstream would
# have raised (red) or lowered (blue) the drag of the 8 :math:`t_c` to come.

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
# - A controller in the loop: its reaction to a sample goes into the next call's weights, between two calls of ``back``.
#   :doc:`Gradients of the flow </explanation/gradients>` has the rule, the cost, and the bound on memory.
# - From the Gymnasium environment: ``Tape(env.unwrapped.plant)``, between two steps.
# - Small disturbances of this wake grow by a factor of about 1.2 per :math:`t_c`. Over 25 :math:`t_c` a slope grows
#   fiftyfold and still points downhill; over 60 :math:`t_c` it no longer tells where a real step leads.
