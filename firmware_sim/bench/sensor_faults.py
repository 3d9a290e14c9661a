"""The faults of the transducers' readings: their descriptions, and the functions that apply the faults.

The function of a fault is called in the order of time with readings in Cp at the S sensors, of one instant, shape (S,),
or of n instants, shape (n, S). It returns the faulty readings and leaves its argument unchanged. The function counts
the instants, so one call for n instants and n calls for one instant give the same readings.

Levels are in global deviations. The global deviation is the standard deviation of all 90 pressures taken together, each
about its own mean (paper, appendix B). So a level is the same difference of Cp at every sensor.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from can_bridge.bus.faults.fault import NS, Span
from contract.arrays import Array
from contract.config.rules import Finite, NonNegative, Positive, require
from contract.config.tree import Config

GLOBAL_DEVIATION: Final = 0.1276
"""Standard deviation in Cp of all 90 pressures of the shipped recording's training episodes, taken together."""
SensorFault = Callable[[Array], Array]


@dataclass(frozen=True, kw_only=True)
class SensorDisturbance(Span, ABC, section="sensor_disturbance"):
    """A fault of the transducers' readings."""

    @property
    def named(self) -> tuple[str, ...]:
        """Names of the affected sensors; an empty tuple means all sensors."""
        return ()

    @abstractmethod
    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        """Return a function that applies the fault to the readings at the indices `at`, as the module describes."""


@dataclass(frozen=True, kw_only=True)
class Noise(SensorDisturbance, section="noise"):
    """A white Gaussian noise with the standard deviation `level`, independent for every sensor (paper, appendix B)."""

    level: NonNegative[float]

    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        draw = np.random.default_rng(seed).standard_normal
        return lambda cp: cp + self.level * draw(cp.shape) * GLOBAL_DEVIATION


@dataclass(frozen=True, kw_only=True)
class Quantise(SensorDisturbance, section="quantise"):
    """A rounding of all readings to a multiple of `step`, in Pa."""

    step: Positive[float]

    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        step = self.step / config.operating_point.dynamic_pressure
        return lambda cp: np.round(cp / step) * step


@dataclass(frozen=True, kw_only=True)
class OneSensor(SensorDisturbance, section="one_sensor"):
    """A fault of one sensor."""

    sensor: str

    @property
    def named(self) -> tuple[str, ...]:
        return (self.sensor,)


@dataclass(frozen=True, kw_only=True)
class Bias(OneSensor, section="bias"):
    """A constant offset on one sensor."""

    level: Finite[float]

    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        return lambda cp: _with(cp, at, cp[..., at] + self.level * GLOBAL_DEVIATION)


@dataclass(frozen=True, kw_only=True)
class Drift(OneSensor, section="drift"):
    """An offset on one sensor that grows linearly to `level` in `over_s` s, and then stays constant."""

    level: Finite[float]
    over_s: Positive[float] = 5.0

    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        # A drift that takes less than a period reaches its final value at the second reading.
        grows, step = max(1, round(self.over_s * NS / config.period_ns)), 0

        def drifted(cp: Array) -> Array:
            nonlocal step
            steps = np.minimum(step + np.arange(len(np.atleast_2d(cp))), grows)
            step += len(steps)
            drift = self.level * GLOBAL_DEVIATION * (steps / grows)
            return _with(cp, at, cp[..., at] + drift.reshape(*cp.shape[:-1], 1))

        return drifted


@dataclass(frozen=True, kw_only=True)
class Stuck(OneSensor, section="stuck"):
    """A sensor that repeats its first reading in the span."""

    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        first: list[Array] = []

        def stuck(cp: Array) -> Array:
            if not first:
                first.append(np.atleast_2d(cp)[0, at].copy())
            return _with(cp, at, first[0])

        return stuck


@dataclass(frozen=True, kw_only=True)
class Dead(OneSensor, section="dead"):
    """A sensor whose reading is always Cp 0."""

    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        return lambda cp: _with(cp, at, 0.0)


@dataclass(frozen=True, kw_only=True)
class Swap(SensorDisturbance, section="swap"):
    """An exchange of the readings of two sensors, whose names are joined by + in a text."""

    sensors: tuple[str, ...]

    @property
    def named(self) -> tuple[str, ...]:
        return self.sensors

    def __post_init__(self) -> None:
        super().__post_init__()
        require(len(set(self.sensors)) == len(self.sensors) == 2, self, "sensors", "two different sensors")

    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        return lambda cp: _with(cp, at, cp[..., at[::-1]])


def _with(cp: Array, at: Sequence[int], values: Array | float) -> Array:
    changed = cp.copy()
    changed[..., at] = values
    return changed
