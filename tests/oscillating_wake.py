"""Tables of an oscillating wake in closed form: four sensors on a symmetric body, three files of 300 rows."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

NAMES = ("p1", "p2", "p3", "p4")
POSITIONS = ((0.4, 0.5), (0.4, -0.5), (1.0, 0.3), (1.0, -0.3))
PERIOD, LIMIT = 0.3, 0.2
FILES = {"sweep": (1, True), "calm": (2, False), "held_out": (3, True)}  # seed, and whether it is forced


def series(seed: int, forced: bool, steps: int = 300) -> dict[str, Array]:
    """t, action, Cd, Cl (n,), and Cp (n, 4): mean Cd 1.339 and mean Cp -0.401 in sweep."""
    random, t = np.random.default_rng(seed), PERIOD * np.arange(steps)
    action = 0.19 * np.sin(t / 20 + seed) * np.sin(2 * np.pi * (0.12 + 0.0008 * t) * t) if forced else np.zeros(steps)
    phase, side = 2 * np.pi * 0.2 * t + seed, 0.8 * np.array(POSITIONS)[:, 1]
    swing = side * np.sin(phase[:, None] + 0.3 * np.arange(4) // 2) + side * action[:, None]
    return {
        "t": t,
        "action": action,
        "Cp": -0.4 + swing + 0.01 * random.standard_normal((steps, 4)),
        "Cd": 1.35 + 0.05 * np.cos(2 * phase) - action**2 + 0.01 * random.standard_normal(steps),
        "Cl": 0.8 * np.sin(phase) + action + 0.02 * random.standard_normal(steps),
    }
