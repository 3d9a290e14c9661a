"""The resampling of the past rows that a controller reads, for speeds other than the design speed.

A controller expects rows that are `flow.control_period` convective times apart. At s times the design speed, recorded
rows are s times as far apart in convective time. So the rows are interpolated at the times that the controller expects.

Below the design speed, a control period is shorter in convective time. A controller that reacted fully in every period
would react faster than it was designed to. The jets act on the pressures at the wall immediately, so the controller
would drive the air back and forth. Therefore pressures and command move only part of the way to their new values in a
period (`followed`). At s times the design speed, this share is s for the pressures and s^2 for the command.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from contract.arrays import Array, Index

T = TypeVar("T", Array, float)


class Places(NamedTuple):
    """The interpolation positions of the m rows that a controller reads, oldest first. `newer` (m,) is the index of the
    first recorded row at a position's time or later, `share` (m,) the position in [0, 1) towards the row before it."""

    newer: Index
    share: Array

    def of(self, rows: Array) -> Array:
        """Interpolate the rows (n, ...) of n periods at these m positions. Returns (m, ...)."""
        share = self.share.reshape(-1, *[1] * (rows.ndim - 1))
        newer, older = rows[self.newer], rows[self.newer - (self.share > 0.0)]
        return np.asarray(newer + share * (older - newer))


def followed(before: T, new: T, share: float) -> T:
    """Return the value at a share of the way from `before` to `new`; with a share of 1 or more, the value is `new`."""
    return new if share >= 1.0 else before + share * (new - before)


def places(speeds: Sequence[float], length: int) -> Places:
    """Compute the interpolation positions of `length` rows; the last row is at the newest period. If the past is too
    short, there are fewer positions. `speeds` has the speeds at the samples of n periods, oldest first, as
    positive ratios to the design speed. A speed is used for the whole period that ends with its sample."""
    newer, share = np.empty(length, dtype=np.intp), np.empty(length)
    at, age = len(speeds) - 1, 0.0
    for steps in range(length):
        while at > 0 and age + speeds[at] <= steps:
            age += speeds[at]
            at -= 1
        if at == 0 and age < steps:
            return Places(newer[length - steps :], share[length - steps :])
        newer[-1 - steps], share[-1 - steps] = at, (steps - age) / speeds[at]
    return Places(newer, share)
