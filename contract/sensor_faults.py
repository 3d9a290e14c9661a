"""Faults of pressure sensors: white noise, bias, drift, sensors that are stuck, dead or swapped, steps.

A fault is called with readings in order of time, one frame (N,) or n frames (n, N) of N sensors in any floating-point
type, and returns what the faulty sensors read, in that type. It keeps its place in time, so one call for n frames and n
calls for one frame give the same. A fault is built for one episode; noise may run on through the next.

Levels are in global deviations: the standard deviation of all 90 pressures taken together, each about its own mean
(paper, appendix B; bias, drift and dead sensors are what the paper leaves open). So one level means the same pressure
at every sensor. `unit`, (N,), is one global deviation in the unit of the readings.
"""

from typing import Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.errors import ConfigError

_F = TypeVar("_F", np.float32, np.float64)


class SensorFault(Protocol):
    """Readings (N,) or (n, N) as they would be -> as they are read; the argument stays as it is."""

    def __call__(self, readings: npt.NDArray[_F], /) -> npt.NDArray[_F]: ...


class Noise:
    """White Gaussian noise of `level` global deviations on every sensor, independent; raises ConfigError below 0."""

    def __init__(self, level: float, unit: Array, *, seed: int) -> None:
        if level < 0:
            raise ConfigError(f"noise level {level}: must be non-negative")
        self._level, self._unit = level, unit
        self._generator = np.random.default_rng(seed)

    def __call__(self, readings: npt.NDArray[_F], /) -> npt.NDArray[_F]:
        return _added(readings, self._level * self._generator.standard_normal(readings.shape) * self._unit)


class Bias:
    """A constant `level` global deviations on one sensor, given by its place among the N."""

    def __init__(self, level: float, unit: Array, sensor: int) -> None:
        self._offset = np.zeros(len(unit))
        self._offset[sensor] = level * unit[sensor]

    def __call__(self, readings: npt.NDArray[_F], /) -> npt.NDArray[_F]:
        return _added(readings, self._offset)


class Drift:
    """A bias on one sensor that grows evenly from 0 to `level` global deviations over `steps` frames, and stays."""

    def __init__(self, level: float, unit: Array, sensor: int, *, steps: int) -> None:
        self._ramp = np.zeros((steps, len(unit)))
        self._ramp[:, sensor] = np.linspace(0.0, level * unit[sensor], steps)
        self._step = 0

    def __call__(self, readings: npt.NDArray[_F], /) -> npt.NDArray[_F]:
        frames = np.atleast_2d(readings)
        steps = np.minimum(self._step + np.arange(len(frames)), len(self._ramp) - 1)
        self._step += len(frames)
        return _added(readings, self._ramp[steps].reshape(readings.shape))


class Dead:
    """One sensor without supply, which reads 0."""

    def __init__(self, sensor: int) -> None:
        self._sensor = sensor

    def __call__(self, readings: npt.NDArray[_F], /) -> npt.NDArray[_F]:
        dead = readings.copy()
        dead[..., self._sensor] = 0.0
        return dead


class Swapped:
    """Two sensors, each with the other's reading, as after a mistake in the wiring."""

    def __init__(self, first: int, second: int) -> None:
        self._places, self._from = [first, second], [second, first]

    def __call__(self, readings: npt.NDArray[_F], /) -> npt.NDArray[_F]:
        swapped = readings.copy()
        swapped[..., self._places] = readings[..., self._from]
        return swapped


class Quantised:
    """Every sensor reads whole multiples of a step, in the unit of the readings; raises ConfigError unless above 0."""

    def __init__(self, step: float) -> None:
        if not step > 0:
            raise ConfigError(f"quantisation step {step}: must be positive")
        self._step = step

    def __call__(self, readings: npt.NDArray[_F], /) -> npt.NDArray[_F]:
        return (np.round(readings / self._step) * self._step).astype(readings.dtype)


class Stuck:
    """One sensor whose first reading never changes."""

    def __init__(self, sensor: int) -> None:
        self._sensor = sensor
        self._reading: float | None = None

    def __call__(self, readings: npt.NDArray[_F], /) -> npt.NDArray[_F]:
        if self._reading is None:
            self._reading = float(np.atleast_2d(readings)[0, self._sensor])
        stuck = readings.copy()
        stuck[..., self._sensor] = self._reading
        return stuck


def _added(readings: npt.NDArray[_F], change: Array) -> npt.NDArray[_F]:
    # Rounded before the sum, so that the type of the readings is kept.
    return readings + change.astype(readings.dtype)
