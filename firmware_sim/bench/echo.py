"""Which of its pressure frames a jet command rests on, seen from the vehicle.

A command echoes the counter of a Pressure frame, which repeats after 256 frames, in the classic set after 16. An echo
that stands still would look fresh again after that. So echoes are followed one by one: each is taken for the first
frame with its counter that is not older than the frame echoed before it. Where commands were interrupted there is
nothing to follow, and the newest frame with that counter is meant.
"""

from dataclasses import dataclass, replace


@dataclass(frozen=True, kw_only=True)
class EchoTracker:
    """A value; frames are numbered as they are sent, from the first counter on.

    Attributes:
        kept: times of sending of the latest frames, the newest last; at most a counter's period of them.
        newest: number of the newest frame; None before the first.
        echoed: number of the frame echoed last; None if there is nothing to follow.
    """

    counter_period: int
    kept: tuple[int, ...] = ()
    newest: int | None = None
    echoed: int | None = None

    def sent(self, counter: int, now_ns: int) -> "EchoTracker":
        """After a frame with this counter was sent."""
        newest = counter
        if self.newest is not None:
            newest = self.newest + (counter - self.newest) % self.counter_period
        return replace(self, newest=newest, kept=(*self.kept, now_ns)[-self.counter_period :])

    def interrupted(self) -> "EchoTracker":
        """After commands stayed away, or came without an echo."""
        return replace(self, echoed=None)

    def received(self, counter: int) -> "EchoTracker":
        """After a command with this echo; without one to follow if it is of no frame that was sent."""
        if self.newest is None:
            return self
        oldest = self.newest - len(self.kept) + 1 if self.echoed is None else self.echoed
        number = oldest + (counter - oldest) % self.counter_period
        return replace(self, echoed=number if number <= self.newest else None)

    @property
    def age(self) -> int | None:
        """Frames sent since the one echoed last; None without one."""
        return None if self.newest is None or self.echoed is None else self.newest - self.echoed

    @property
    def sampled_ns(self) -> int | None:
        """When the frame echoed last was sent; None without one, or if that is more than a counter's period ago."""
        age = self.age
        return self.kept[-1 - age] if age is not None and age < len(self.kept) else None
