"""The past at another speed: rows of control periods read again at steps of one convective time each.

A controller knows steps of `flow.control_period` convective times. At s times its speed a control period lasts s of
these steps. What lies behind is then read between the rows of the periods, as far back in convective times, that is in
lengths travelled, as the controller expects it.

Below its own speed the periods are shorter than these steps. A controller that answers in each of them to what it just
measured would answer faster than it was made to, and jets act on the pressures at the wall at once: it sets the air in
motion to and fro. What is read and what is commanded therefore go only part of the way in a period (`followed`): with
s for the speed, pressures the share s and the command the share s^2.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from contract.arrays import Array, Index


class Places(NamedTuple):
    """Where the rows lie that a controller reads, oldest first.

    Attributes:
        newer: (m,) the row of a period, at that time or after it.
        share: (m,) how far from there towards the row before it, 0 to below 1.
    """

    newer: Index
    share: Array

    def of(self, rows: Array) -> Array:
        """(m, ...) the rows between these (n, ...)."""
        share = self.share.reshape(-1, *[1] * (rows.ndim - 1))
        newer, older = rows[self.newer], rows[self.newer - (self.share > 0.0)]
        return np.asarray(newer + share * (older - newer))


T = TypeVar("T", Array, float)


def followed(before: T, new: T, share: float) -> T:
    """Where pressures that are kept, or a command, are after a period in which they should get to `new`.

    They get there with a share of 1 and above, at the controller's own speed and above it.
    """
    return new if share >= 1.0 else before + share * (new - before)


def places(speeds: Sequence[float], length: int) -> Places:
    """Where `length` rows lie, the newest at the newest period; fewer where the periods do not reach back that far.

    Args:
        speeds: (n,) at each period's sample, oldest first, as a ratio to the controller's own, above 0; the period that
            ends with a sample is taken to have had its speed.
        length: L.
    """
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
