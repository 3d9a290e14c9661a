"""Standardisation of pressures, action and forces, fitted to the training episodes and their mirror images."""

from collections.abc import Sequence

import numpy as np

from contract import sensors
from contract.arrays import Array, Index
from contract.errors import DatasetError
from contract.recording.dataset import Episode
from contract.release.manifest import Scaling


def fit_scaling(episodes: Sequence[Episode]) -> Scaling:
    """Mean and standard deviation of the episodes taken together with their mirror images.

    The mirror image (y -> -y) permutes the sensors and turns the signs of action and lift. Statistics over both
    are symmetric: mean action and mean Cl are 0 and mirrored sensors share mean and deviation, so that mirroring
    commutes with scaling.

    Raises:
        DatasetError: if a sensor, the action or a force never changes; the message names it.
    """
    pressure = np.concatenate([episode.series["Cp"] for episode in episodes])
    action = np.concatenate([episode.series["action"] for episode in episodes])
    drag, lift = (np.concatenate([episode.series[name] for episode in episodes]) for name in ("Cd", "Cl"))
    # Before pooling, in which the mirror image of a dead sensor would hide it.
    for name, values in zip(sensors.NAMES, pressure.T, strict=True):
        _refuse_constant(f"sensor {name}", values)
    for name, values in (("action", action), ("Cd", drag), ("Cl", lift)):
        _refuse_constant(name, values)
    mirror = sensors.mirror_permutation()
    mean = pressure.mean(axis=0)
    mean = (mean + mean[mirror]) / 2
    variance = np.square(pressure - mean).mean(axis=0)
    std = np.sqrt((variance + variance[mirror]) / 2)
    return Scaling(
        pressure_mean=tuple(mean.tolist()),
        pressure_std=tuple(std.tolist()),
        action_std=float(np.sqrt(np.square(action).mean())),
        force_mean=(float(drag.mean()), 0.0),
        force_std=(float(drag.std()), float(np.sqrt(np.square(lift).mean()))),
    )


def global_deviation(scaling: Scaling) -> float:
    """Standard deviation of all 90 pressures taken together, in Cp, each about its own mean (paper, appendix B)."""
    return float(np.sqrt(np.square(scaling.pressure_std).mean()))


def unit_steps(scaling: Scaling, chosen: Index) -> Array:
    """(N,) one global deviation in each chosen sensor's standardised pressure."""
    steps: Array = global_deviation(scaling) / np.array(scaling.pressure_std)[chosen]
    return steps


def _refuse_constant(name: str, values: Array) -> None:
    if np.ptp(values) == 0.0:
        raise DatasetError(f"{name} is constant at {values[0]:g} in all training episodes: nothing to learn from")
