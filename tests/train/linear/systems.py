"""Recordings of linear systems whose coefficients are known."""

from collections.abc import Sequence

import numpy as np
import scipy.linalg

from contract.arrays import Array
from contract.recording.dataset import Dataset, Episode
from contract.recording.facts import PlantFacts
from contract.sensor_layout import SensorLayout

NAMES = ("up", "down", "left", "right")
LAYOUT = SensorLayout.of(NAMES, np.array([[1.0, 0.5], [1.0, -0.5], [2.0, 0.2], [2.0, -0.2]]))
PERIOD = 0.2
KNOWN = np.array(
    [
        # Oldest lag first; columns y1, y2, a. Rows y1, y2, Cl.
        [[-0.8, 0.0, 0.2], [1.7, 0.1, 0.5]],
        [[0.1, -0.5, 0.0], [0.0, 1.2, -0.3]],
        [[0.3, 0.0, 0.0], [1.0, -0.5, 0.1]],
    ]
)


def simulated(steps: int, seed: int, *, noise: float = 0.0) -> tuple[Array, Array]:
    """Rows (y_k, a_k), (n, 3), under white actions of 0.05, and Cl (n,)."""
    rng = np.random.default_rng(seed)
    rows, lift = np.zeros((steps, 3)), np.zeros(steps)
    rows[:, 2] = 0.05 * rng.uniform(-1.0, 1.0, steps)
    for k in range(1, steps - 1):
        *y, lift[k + 1] = np.tensordot(KNOWN, rows[k - 1 : k + 1], axes=2) + noise * rng.normal(size=3)
        rows[k + 1, :2] = y
    return rows, lift


def episode(name: str, steps: int, seed: int, *, noise: float = 0.0, probe: bool = False) -> Episode:
    rows, lift = simulated(steps, seed, noise=noise)
    common = 0.1 * np.sin(0.3 * np.arange(steps))[:, None] - 0.5
    y1, y2 = rows[:, :1], rows[:, 1:2]
    Cp = np.hstack([common + y1 / 2, common - y1 / 2, common + y2 / 2, common - y2 / 2])
    series = {
        "t": PERIOD * np.arange(steps),
        "action": rows[:, 2],
        "Cp": Cp,
        "Cd": 0.9 + 0.1 * np.cos(0.2 * np.arange(steps)),
        "Cl": lift,
    }
    if probe:
        series["Uy_probe"] = np.roll(lift, 3)
    return Episode(name=name, role="train", series=series, initial_action=0.0, provenance={})


def recorded(episodes: Sequence[Episode]) -> Dataset:
    return Dataset(
        episodes=tuple(episodes),
        layout=LAYOUT,
        facts=PlantFacts(control_period=PERIOD, action_limit=0.075, reynolds=500.0),
    )


def growing(radius: float, angle: float) -> Array:
    """Coefficients (1, 2, 2) of y_{k+1} = 2 r cos(angle) y_k - r^2 y_{k-1}: poles r exp(+-i angle)."""
    companion = scipy.linalg.companion(np.poly([radius * np.exp(1j * angle), radius * np.exp(-1j * angle)]).real)
    return np.array([[[companion[0, 1], 0.0], [companion[0, 0], 0.1]]])
