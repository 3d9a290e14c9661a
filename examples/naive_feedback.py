"""Run a simple feedback, in which the jets follow the rear edges' pressure difference, and print the drag.

    python examples/naive_feedback.py [control steps]

If the gain is positive, the slot at the edge with the higher pressure blows; if negative, the other slot blows.
"""

import sys

import gymnasium
import numpy as np
from rich import print

import wake.env  # noqa: F401  (registers the environment)

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 500
env = gymnasium.make("stillwake/TruckWake-v0", sensor_names=("upper_39", "lower_39"), episode_steps=steps)
for gain in (0.0, 0.1, -0.1):
    (upper, lower), info = env.reset(seed=0, options={"phase_steps": 0})
    rows, truncated = [], False
    while not truncated:
        (upper, lower), _, _, truncated, info = env.step([gain * (upper - lower)])
        rows.append([info[name] for name in ("Cd", "Cd_net", "Cl", "jet_power")])
    settled = np.array(rows[2 * len(rows) // 5 :])
    Cd, net, Cl, power = settled.mean(axis=0)
    print(
        f"gain {gain:+.1f}: Cd {Cd:.3f}, net {net:.3f}, mean Cl {Cl:+.3f}, "
        f"|Cl| {np.abs(settled[:, 2]).mean():.3f}, jet power {power:.3f}"
    )
