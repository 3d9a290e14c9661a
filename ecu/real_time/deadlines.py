"""When the next period begins, on an absolute clock: no error adds up, and nothing is ever caught up.

A deadline that work on the one before ran past is left out and counted. An ECU also follows the vehicle's sampling,
whose clock is another: it looks when pressures arrive and moves its deadlines a little each period until they lie a
fixed time behind.
"""

from dataclasses import dataclass, replace
from statistics import median_low
from typing import Final, Self

LARGEST_SLEW: Final = 32
"""A deadline is moved by at most a period divided by this: half of the lateness at which `ecu.timing`
begins to see periods left out. From the worst phase, half a period, the way is 16 periods long."""
REMEMBERED: Final = 15
"""Arrivals whose median is the expected one: a few that are late in a burst do not move it. It lags 7 periods behind,
in which clocks that differ by 100 ppm come apart by 14 us at 20 ms."""


@dataclass(frozen=True, kw_only=True)
class Deadlines:
    """The period to come; times in ns of one clock that never goes back.

    Attributes:
        period_ns: from one deadline to the next.
        number: of the period, those left out counted.
        left_out: periods so far that were not begun, since work on an earlier one was not done.
        grace_ns: by how much a deadline may have passed when the work before it is done, and still be kept, late.
    """

    period_ns: int
    due_ns: int
    number: int = 0
    left_out: int = 0
    grace_ns: int = 0

    def __post_init__(self) -> None:
        if self.period_ns <= 0:
            raise ValueError(f"period_ns = {self.period_ns}: must be positive")
        if not 0 <= self.grace_ns < self.period_ns:
            raise ValueError(f"grace_ns = {self.grace_ns}: must be in 0..{self.period_ns - 1}")

    def after(self, now_ns: int) -> Self:
        """The next deadline that can still be kept, now that the work on this one is done."""
        late_ns = now_ns - self.grace_ns - (self.due_ns + self.period_ns)
        missed = max(0, -(-late_ns // self.period_ns))
        steps = 1 + missed
        return replace(
            self,
            due_ns=self.due_ns + steps * self.period_ns,
            number=self.number + steps,
            left_out=self.left_out + missed,
        )

    def slewed(self, target_ns: int) -> Self:
        """Moved towards the phase of `target_ns`, the shorter way round and at most a period / LARGEST_SLEW."""
        most = self.period_ns // LARGEST_SLEW
        error_ns = wrapped(target_ns - self.due_ns, self.period_ns)
        return replace(self, due_ns=self.due_ns + min(max(error_ns, -most), most))


@dataclass(frozen=True, kw_only=True)
class Arrivals:
    """The latest arrivals of a periodic message.

    Attributes:
        period_ns: between two.
        latest_ns: up to REMEMBERED of them, oldest first.
    """

    period_ns: int
    latest_ns: tuple[int, ...] = ()

    def seen(self, arrival_ns: int) -> Self:
        """Add one more."""
        return replace(self, latest_ns=(*self.latest_ns, arrival_ns)[-REMEMBERED:])

    def forgotten(self) -> Self:
        """Without any: what comes next is another sender's, or the same one's after a restart."""
        return replace(self, latest_ns=())

    @property
    def expected_ns(self) -> int | None:
        """An instant in the phase of their median; None before there are REMEMBERED of them."""
        if len(self.latest_ns) < REMEMBERED:
            return None
        newest = self.latest_ns[-1]
        return newest + median_low(wrapped(item - newest, self.period_ns) for item in self.latest_ns)


def wrapped(difference_ns: int, period_ns: int) -> int:
    """The difference of two phases, in -period / 2 up to period / 2."""
    return (difference_ns + period_ns // 2) % period_ns - period_ns // 2
