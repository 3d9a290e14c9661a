"""Standardisation of pressures, action and forces, fitted to the training episodes and any mirror images of them."""

from collections.abc import Sequence

import numpy as np

from contract.arrays import Array, Index
from contract.errors import DatasetError
from contract.recording.dataset import Episode
from contract.release.manifest import Scaling
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK


def fit_scaling(episodes: Sequence[Episode], layout: SensorLayout = TRUCK) -> Scaling:
    """Mean and standard deviation of the episodes, taken together with their mirror images where there are any.

    The mirror image (y -> -y) permutes the sensors and turns the signs of action and lift. Statistics over both are
    symmetric: mean action and mean Cl are 0 and mirrored sensors share mean and deviation, so that mirroring commutes
    with scaling. Without mirror images, Cl has a mean of its own; an action is never shifted, so that no action stays
    0, and its deviation is its root mean square in either case. Raises DatasetError if a sensor, the action or a force
    never changes; the message names it.
    """
    pressure = np.concatenate([episode.series["Cp"] for episode in episodes])
    action = np.concatenate([episode.series["action"] for episode in episodes])
    drag, lift = (np.concatenate([episode.series[name] for episode in episodes]) for name in ("Cd", "Cl"))
    # Before pooling, in which the mirror image of a dead sensor would hide it.
    for name, values in zip(layout.names, pressure.T, strict=True):
        _refuse_constant(f"sensor {name}", values)
    for name, values in (("action", action), ("Cd", drag), ("Cl", lift)):
        _refuse_constant(name, values)
    mirror = np.arange(len(layout)) if layout.mirror is None else layout.mirror
    mean = pressure.mean(axis=0)
    mean = (mean + mean[mirror]) / 2
    variance = np.square(pressure - mean).mean(axis=0)
    std = np.sqrt((variance + variance[mirror]) / 2)
    mean_lift = float(lift.mean()) if layout.mirror is None else 0.0
    return Scaling(
        pressure_mean=tuple(mean.tolist()),
        pressure_std=tuple(std.tolist()),
        action_std=float(np.sqrt(np.square(action).mean())),
        force_mean=(float(drag.mean()), mean_lift),
        force_std=(float(drag.std()), float(np.sqrt(np.square(lift - mean_lift).mean()))),
    )


def global_deviation(scaling: Scaling) -> float:
    """Standard deviation of all pressures taken together, in Cp, each about its own mean (paper, appendix B)."""
    return float(np.sqrt(np.square(scaling.pressure_std).mean()))


def unit_steps(scaling: Scaling, chosen: Index) -> Array:
    """(N,) one global deviation in each chosen sensor's standardised pressure."""
    steps: Array = global_deviation(scaling) / np.array(scaling.pressure_std)[chosen]
    return steps


def _refuse_constant(name: str, values: Array) -> None:
    if np.ptp(values) == 0.0:
        raise DatasetError(f"{name} is constant at {values[0]:g} in all training episodes: nothing to learn from")
