"""Percentiles of latencies: values that were measured, never between two of them."""

from math import ceil
from typing import Final, NamedTuple, Self

import numpy as np

from contract.arrays import Array

NEEDED_FOR_P99_9: Final = 1_000
"""Values below which the 99.9th percentile by nearest rank is the maximum itself."""


class Quantiles(NamedTuple):
    """Of one stage, in ms; None where there was not a single value.

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
        """Those of latencies in ns, (n,); NaN stands for a period without one and is left out, infinity is not."""
        found = np.sort(values_ns[~np.isnan(values_ns)])
        if not len(found):
            return cls(None, None, None, None, 0)
        p50, p99, p99_9, most = (nearest_rank(found, share) / 1e6 for share in (0.5, 0.99, 0.999, 1.0))
        return cls(p50, p99, p99_9, most, len(found))


def nearest_rank(ascending: Array, share: float) -> float:
    """The smallest value that at least this share of all do not exceed (Hyndman and Fan's definition 1).

    Args:
        ascending: the values, (n,), at least one.
        share: in (0, 1].
    """
    if not 0.0 < share <= 1.0:
        raise ValueError(f"share = {share}: must be in (0, 1]")
    # 0.999 * 3000 is 2997.0000000000005 in binary: a rank is not to grow by rounding.
    rank = ceil(round(share * len(ascending), 6))
    return float(ascending[rank - 1])
