"""The time averages of a shedding wake; all studies use these rules.

Averages run from the first to the last instant at which the lift crosses zero upwards. Linear interpolation between
samples gives these instants; the trapezoidal rule integrates the series between them. For a signal with 24 samples per
cycle, such as this wake's lift, the average over a dozen cycles has an error of 1e-6 of the amplitude. Without
interpolation of the crossings, the error would be 1e-3.

The lift of a wake under control may cross zero many times within a cycle. But the wake and the jets still act near the
shedding frequency. So a controlled wake is averaged over as many whole cycles of the uncontrolled wake as fit, counted
back from the last sample (`over_last_cycles`). With sinusoidal forcing, the cycles of the sine are used.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.errors import PlantError


@dataclass(frozen=True, kw_only=True, eq=False)
class CycleAverage:
    """The weights for averages over whole cycles. `weights` (n,) belong to the n samples; their sum is 1. `frequency`
    is in cycles per t_c; it is the Strouhal number if nothing forces the wake."""

    weights: Array
    cycles: int
    frequency: float

    def mean(self, values: npt.ArrayLike) -> Array:
        """Return the weighted mean (...) of values (n, ...) over the n samples."""
        return np.asarray(np.tensordot(self.weights, np.asarray(values, dtype=np.float64), axes=1))

    def std(self, values: npt.ArrayLike) -> Array:
        """Return the root of the mean squared deviation from the mean, (...)."""
        deviation = np.asarray(values, dtype=np.float64) - self.mean(values)
        return np.sqrt(self.mean(deviation * deviation))


def over_cycles(t: Array, lift: Array) -> CycleAverage:
    """Return the weights for averages over the whole cycles in a series. `t` (n,) has increasing sample times in t_c,
    and `lift` (n,) is Cl. Raises PlantError if the series holds no whole cycle."""
    up = np.flatnonzero((lift[:-1] < 0.0) & (lift[1:] >= 0.0))
    if len(up) < 2:
        raise PlantError(
            f"the lift crosses zero upwards {len(up)} times in {len(t)} samples: an average needs a whole cycle, so "
            "run longer"
        )
    crossings = t[up] - lift[up] * (t[up + 1] - t[up]) / (lift[up + 1] - lift[up])
    first, last, cycles = float(crossings[0]), float(crossings[-1]), len(up) - 1
    weights, frequency = _trapezoids(t, first, last) / (last - first), cycles / (last - first)
    return CycleAverage(weights=weights, cycles=cycles, frequency=frequency)


def over_last_cycles(t: Array, frequency: float) -> CycleAverage:
    """Return the weights for averages over the last whole cycles of a series. `t` (n,) has increasing sample times in
    t_c; `frequency` is the uncontrolled wake's, in cycles per t_c. Raises PlantError if t spans less than a cycle."""
    span = float(t[-1] - t[0]) if len(t) else 0.0
    # A span may be a whole number of cycles, and rounding must not remove its last cycle.
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
    """Return the weights (n,) that integrate a piecewise linear series from `first` to `last`."""
    width = np.diff(t)
    # The part of each interval that counts, as fractions of its width.
    begin = np.clip((first - t[:-1]) / width, 0.0, 1.0)
    end = np.clip((last - t[:-1]) / width, 0.0, 1.0)
    right = 0.5 * (end * end - begin * begin) * width
    weights = np.zeros(len(t))
    weights[:-1] += (end - begin) * width - right
    weights[1:] += right
    return weights
