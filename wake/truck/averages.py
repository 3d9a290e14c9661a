"""Time averages of a wake that sheds: one rule for every study.

An average over a part of a cycle depends on where the series was cut. So averages run from the first to the last
instant at which the lift crosses zero upwards, each found on the straight line between two samples, and hold a whole
number of cycles. In between, the series is integrated by the trapezoidal rule; of the two intervals in which the
average begins and ends, the part inside counts, on the straight line between their samples. The standard deviation is
the root of the same integral of (x - mean)^2. A signal of 24 samples a cycle, as this wake's lift, is averaged to 1e-6
of its amplitude over a dozen cycles.

Two other rules are worse. Whole samples between the crossings put the cut up to a sample off: 1e-3 of the amplitude.
A line drawn through the samples and then squared makes the lift's standard deviation 0.6 % too small, and that of the
drag, which has twice the frequency, 2 %.

A wake under control may hardly shed. Its lift then crosses zero many times within a cycle, by what is left of the
motion and by what the jets do, and the crossings mark no cycles. But the wake and the jets still act near the shedding
frequency, so a controlled wake is averaged over whole cycles of the uncontrolled one: as many as fit, counted back from
the last sample (`over_last_cycles`). Where control fails, the wake sheds as before and the rule is the first one again,
with another phase. A wake that a sine drives is averaged over the sine's last cycles in the same way.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.errors import PlantError


@dataclass(frozen=True, kw_only=True, eq=False)
class Average:
    """Weights (n,) of the samples; their sum is 1."""

    weights: Array

    def mean(self, values: npt.ArrayLike) -> Array:
        """Weighted mean of (n, ...) over the samples, (...)."""
        return np.asarray(np.tensordot(self.weights, np.asarray(values, dtype=np.float64), axes=1))

    def std(self, values: npt.ArrayLike) -> Array:
        """Root of the mean squared deviation from the mean, (...)."""
        deviation = np.asarray(values, dtype=np.float64) - self.mean(values)
        return np.sqrt(self.mean(deviation * deviation))


@dataclass(frozen=True, kw_only=True, eq=False)
class CycleAverage(Average):
    """An average over whole cycles of the lift. `frequency` is in cycles per t_c: the Strouhal number of a wake without
    forcing."""

    cycles: int
    frequency: float


def over_cycles(t: Array, lift: Array) -> CycleAverage:
    """The average over the whole cycles of a series. Raises PlantError if the series holds no whole cycle.

    Args:
        t: instants of the samples, rising, (n,); t_c.
        lift: Cl then, (n,).
    """
    up = np.flatnonzero((lift[:-1] < 0.0) & (lift[1:] >= 0.0))
    if len(up) < 2:
        raise PlantError(
            f"the lift crosses zero upwards {len(up)} times in {len(t)} samples: an average needs a whole cycle, so "
            "run longer"
        )
    crossings = t[up] - lift[up] * (t[up + 1] - t[up]) / (lift[up + 1] - lift[up])
    first, last = float(crossings[0]), float(crossings[-1])
    return CycleAverage(
        weights=_trapezoids(t, first, last) / (last - first),
        cycles=len(up) - 1,
        frequency=(len(up) - 1) / (last - first),
    )


def over_last_cycles(t: Array, frequency: float) -> CycleAverage:
    """The average over the last whole cycles of a frequency that is known from elsewhere. Raises PlantError if the
    series is shorter than a cycle.

    Args:
        t: instants of the samples, rising, (n,); t_c.
        frequency: cycles per t_c; of the same wake without control.
    """
    span = float(t[-1] - t[0]) if len(t) else 0.0
    # Samples stand at multiples of a step: a span of whole cycles must not lose one to rounding.
    cycles = int(span * frequency + 1e-9)
    if cycles < 1:
        raise PlantError(
            f"{len(t)} samples span {span:g} t_c: an average needs a whole cycle of {1.0 / frequency:.2f} t_c, so run "
            "longer"
        )
    last = float(t[-1])
    first = max(float(t[0]), last - cycles / frequency)
    return CycleAverage(weights=_trapezoids(t, first, last) / (last - first), cycles=cycles, frequency=frequency)


def _trapezoids(t: Array, first: float, last: float) -> Array:
    """Weights whose sum with a series is the integral of the line through its samples from `first` to `last`, (n,)."""
    width = np.diff(t)
    # The part of every interval that counts, as shares from its left end.
    begin = np.clip((first - t[:-1]) / width, 0.0, 1.0)
    end = np.clip((last - t[:-1]) / width, 0.0, 1.0)
    right = 0.5 * (end * end - begin * begin) * width
    weights = np.zeros(len(t))
    weights[:-1] += (end - begin) * width - right
    weights[1:] += right
    return weights
