"""Controllers that are a formula: what the literature tries first on a wake that sheds.

Each maps the ECU's window to an action (`benchmarks.roads.loop.Law`). The signal of the feedback ones is the pressure
difference between mirror-placed sensors, which is zero in a symmetric flow.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks.roads.loop import Law
from contract.arrays import Array

SHEDDING: Final = 0.2
"""Frequency of the wake without control, cycles per t_c."""


@dataclass(frozen=True, kw_only=True)
class Constant:
    """Always the same action: the jets have no net flow, so one blows as much as the other sucks."""

    action: float

    def __call__(self, window: Array, committed: float) -> float:
        return self.action


class Sine:
    """A sine without feedback, a = A sin(2 pi f (t - t_0) + phase), from the first command on.

    Args:
        phase: at the first command, rad.
        period: control period, t_c.
    """

    def __init__(self, *, amplitude: float, frequency: float, phase: float, period: float) -> None:
        self._amplitude, self._phase = amplitude, phase
        self._advance, self._count = 2.0 * np.pi * frequency * period, 0

    def __call__(self, window: Array, committed: float) -> float:
        action = self._amplitude * np.sin(self._phase + self._advance * self._count)
        self._count += 1
        return float(action)


@dataclass(frozen=True, kw_only=True)
class Proportional:
    """a = gain times the difference of two columns, so many periods ago."""

    gain: float
    delay: int
    columns: tuple[int, int]

    def __call__(self, window: Array, committed: float) -> float:
        row = window[-1 - self.delay]
        return float(self.gain * (row[self.columns[0]] - row[self.columns[1]]))


@dataclass(frozen=True, kw_only=True)
class Opposition:
    """a = -gain times the rate of the difference of two columns, over the last periods.

    Attributes:
        gain: in U_inf W t_c.
        over: periods that the rate is taken over.
        period: control period, t_c.
    """

    gain: float
    columns: tuple[int, int]
    period: float
    over: int = 2

    def __call__(self, window: Array, committed: float) -> float:
        signal = window[:, self.columns[0]] - window[:, self.columns[1]]
        return float(-self.gain * (signal[-1] - signal[-1 - self.over]) / (self.over * self.period))


@dataclass(frozen=True, kw_only=True)
class PhaseControl:
    """A sine locked to the shedding: a = A sin(phase of the difference + shift).

    The phase at the window's end is that of the best sine of one frequency in the least squares, with a mean.

    Attributes:
        frequency: of the estimator, cycles per t_c.
        shift: rad; it also makes up for the delay of the loop.
    """

    amplitude: float
    shift: float
    columns: tuple[int, int]
    period: float
    frequency: float = SHEDDING

    def __call__(self, window: Array, committed: float) -> float:
        signal = window[:, self.columns[0]] - window[:, self.columns[1]]
        return float(self.amplitude * np.sin(self.phase(signal) + self.shift))

    def phase(self, signal: Array) -> float:
        """The phase of the last value of (n,), rad: 0 where the sine crosses zero upwards."""
        angle = 2.0 * np.pi * self.frequency * self.period * np.arange(1 - len(signal), 1)
        basis = np.stack([np.sin(angle), np.cos(angle), np.ones_like(angle)], axis=1)
        of_sine, of_cosine, _ = np.linalg.lstsq(basis, signal, rcond=None)[0]
        return float(np.arctan2(of_cosine, of_sine))


class BangBang:
    """The sign of another law's action, times the limit; nothing where that is small.

    Args:
        dead: actions up to this become zero, U_inf W.
    """

    def __init__(self, law: Law, *, limit: float, dead: float) -> None:
        self._law, self._limit, self._dead = law, limit, dead

    def __call__(self, window: Array, committed: float) -> float:
        wanted = self._law(window, committed)
        return float(np.sign(wanted) * self._limit) if abs(wanted) > self._dead else 0.0
