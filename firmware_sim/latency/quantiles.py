"""Percentiles of latencies: values that were measured, never between two of them."""

from typing import Final, NamedTuple, Self

import numpy as np

from contract.arrays import Array

NEEDED_FOR_P99_9: Final = 1_000
"""Values below which the 99.9th percentile by nearest rank is the maximum itself."""


class Quantiles(NamedTuple):
    """Percentiles of one stage, in ms; None where there was not a single value.

    Attributes:
        p50, p99, p99_9, max: percentiles.
        number: of the values.
    """

    p50: float | None
    p99: float | None
    p99_9: float | None
    max: float | None
    number: int

    @classmethod
    def of(cls, values_ns: Array) -> Self:
        """Percentiles of latencies in ns, (n,); NaN, a period without one, is left out, infinity is not."""
        values = values_ns[~np.isnan(values_ns)]
        if not len(values):
            return cls(None, None, None, None, 0)
        # By nearest rank: the smallest value that at least this share of all do not exceed.
        p50, p99, p99_9, most = np.quantile(values, [0.5, 0.99, 0.999, 1.0], method="inverted_cdf") / 1e6
        return cls(float(p50), float(p99), float(p99_9), float(most), len(values))
