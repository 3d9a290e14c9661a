"""Faults of what the transducers read: as a text describes them, and at work.

A fault that has begun is called with readings in Cp in the order of time, one frame (S,) or n frames (n, S), and
returns what the faulty sensors read; the argument stays as it is. It keeps its place in time, so one call for n frames
and n calls for one frame give the same.

Levels are in global deviations: the standard deviation of all 90 pressures taken together, each about its own mean
(paper, appendix B; bias, drift and dead sensors are what the paper leaves open). So one level means the same pressure
at every sensor.
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
"""Cp: standard deviation of all 90 pressures of the shipped recording's training episodes, taken together."""

SensorFault = Callable[[Array], Array]


@dataclass(frozen=True, kw_only=True)
class SensorDisturbance(Span, ABC, section="sensor_disturbance"):
    """A fault of what the transducers read."""

    @property
    def named(self) -> tuple[str, ...]:
        """The sensors that it names; empty for all."""
        return ()

    @abstractmethod
    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        """The fault at work.

        Args:
            at: places of the sensors that it names.
            config: of the run.
            seed: of what it draws.
        """


@dataclass(frozen=True, kw_only=True)
class Noise(SensorDisturbance, section="noise"):
    """White Gaussian noise on every sensor, independent (paper, appendix B)."""

    level: NonNegative[float]
    """Standard deviation, in global deviations."""

    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        """See `SensorDisturbance.begun`, as for the others."""
        draw = np.random.default_rng(seed).standard_normal
        return lambda cp: cp + self.level * draw(cp.shape) * GLOBAL_DEVIATION


@dataclass(frozen=True, kw_only=True)
class Quantise(SensorDisturbance, section="quantise"):
    """Every sensor reads whole steps."""

    step: Positive[float]
    """Pa."""

    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        step = self.step / config.operating_point.dynamic_pressure
        return lambda cp: np.round(cp / step) * step


@dataclass(frozen=True, kw_only=True)
class OneSensor(SensorDisturbance, section="one_sensor"):
    """A fault of one sensor."""

    sensor: str

    @property
    def named(self) -> tuple[str, ...]:
        """See `SensorDisturbance.named`."""
        return (self.sensor,)


@dataclass(frozen=True, kw_only=True)
class Bias(OneSensor, section="bias"):
    """A constant on one sensor."""

    level: Finite[float]
    """Global deviations."""

    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        return lambda cp: _with(cp, at, cp[..., at] + self.level * GLOBAL_DEVIATION)


@dataclass(frozen=True, kw_only=True)
class Drift(OneSensor, section="drift"):
    """A bias that grows evenly, and stays."""

    level: Finite[float]
    """It grows to so many global deviations."""
    over_s: Positive[float] = 5.0
    """How long that takes."""

    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        ramp = np.linspace(0.0, self.level * GLOBAL_DEVIATION, round(self.over_s * NS / config.period_ns) + 1)
        step = 0

        def drifted(cp: Array) -> Array:
            nonlocal step
            steps = np.minimum(step + np.arange(len(np.atleast_2d(cp))), len(ramp) - 1)
            step += len(steps)
            return _with(cp, at, cp[..., at] + ramp[steps].reshape(*cp.shape[:-1], 1))

        return drifted


@dataclass(frozen=True, kw_only=True)
class Stuck(OneSensor, section="stuck"):
    """One sensor keeps reading what it read first."""

    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        first: list[Array] = []

        def stuck(cp: Array) -> Array:
            if not first:
                first.append(np.atleast_2d(cp)[0, at].copy())
            return _with(cp, at, first[0])

        return stuck


@dataclass(frozen=True, kw_only=True)
class Dead(OneSensor, section="dead"):
    """One sensor reads Cp 0."""

    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        return lambda cp: _with(cp, at, 0.0)


@dataclass(frozen=True, kw_only=True)
class Swap(SensorDisturbance, section="swap"):
    """Two sensors, each with the other's reading."""

    sensors: tuple[str, ...]
    """Two names with + between them."""

    @property
    def named(self) -> tuple[str, ...]:
        """See `SensorDisturbance.named`."""
        return self.sensors

    def __post_init__(self) -> None:
        super().__post_init__()
        require(len(set(self.sensors)) == len(self.sensors) == 2, self, "sensors", "two different ones")

    def begun(self, at: Sequence[int], config: Config, seed: int) -> SensorFault:
        return lambda cp: _with(cp, at, cp[..., at[::-1]])


def _with(cp: Array, at: Sequence[int], values: Array | float) -> Array:
    """The readings with other ones at these places."""
    changed = cp.copy()
    changed[..., at] = values
    return changed
