"""The start of the next period, on an absolute clock: lateness does not add up, and a missed period is not repeated.

A period starts at its deadline. If the work of an earlier period is not finished in time, the period is skipped and
counted. An ECU also follows the vehicle's sampling, which has another clock. For this it notes the arrival times of the
pressures, and moves its deadlines a little in each period until they come a fixed time after the arrivals.
"""

from dataclasses import dataclass, replace
from statistics import median_low
from typing import Final, Self

LARGEST_SLEW: Final = 32
"""Divisor of the period: a deadline moves by at most period / 32 per period. `ecu.timing` counts periods as skipped if
steps are repeatedly late by more than period / 16. The largest error, half a period, is corrected in 16 periods."""
REMEMBERED: Final = 15
"""Number of arrivals whose median is the expected arrival, so that a few late frames in a burst do not move it. The
middle arrival is 7 periods old; in 7 periods of 20 ms, clocks whose rates differ by 100 ppm drift apart by 14 us."""


@dataclass(frozen=True, kw_only=True)
class Deadlines:
    """The next period and its deadline; times are in ns of one clock that never goes back.

    Attributes:
        due_ns, number: deadline and number of the period; the number includes the `left_out` skipped periods.
        grace_ns: largest time from a deadline to the start of its period; a period that would start later is skipped.
    """

    period_ns: int
    due_ns: int
    number: int = 0
    left_out: int = 0
    grace_ns: int = 0

    def after(self, now_ns: int) -> Self:
        """Return the next period that can still begin in time if the work for the present period ends at `now_ns`."""
        late_ns = now_ns - self.grace_ns - (self.due_ns + self.period_ns)
        missed = max(0, -(-late_ns // self.period_ns))
        steps = 1 + missed
        due_ns = self.due_ns + steps * self.period_ns
        return replace(self, due_ns=due_ns, number=self.number + steps, left_out=self.left_out + missed)

    def slewed(self, target_ns: int) -> Self:
        """Return the period, with its deadline closer to the phase of `target_ns` by at most period / LARGEST_SLEW."""
        most = self.period_ns // LARGEST_SLEW
        error_ns = wrapped(target_ns - self.due_ns, self.period_ns)
        return replace(self, due_ns=self.due_ns + min(max(error_ns, -most), most))


@dataclass(frozen=True, kw_only=True)
class Arrivals:
    """The latest arrivals of a periodic message: the times of up to REMEMBERED arrivals, oldest first."""

    period_ns: int
    latest_ns: tuple[int, ...] = ()

    def seen(self, arrival_ns: int) -> Self:
        return replace(self, latest_ns=(*self.latest_ns, arrival_ns)[-REMEMBERED:])

    @property
    def expected_ns(self) -> int | None:
        """An instant whose phase is the median phase of the arrivals; None before there are REMEMBERED arrivals."""
        if len(self.latest_ns) < REMEMBERED:
            return None
        newest = self.latest_ns[-1]
        return newest + median_low(wrapped(item - newest, self.period_ns) for item in self.latest_ns)


def wrapped(difference_ns: int, period_ns: int) -> int:
    """Return a difference of two phases, reduced to the range from -period / 2 to period / 2."""
    return (difference_ns + period_ns // 2) % period_ns - period_ns // 2
