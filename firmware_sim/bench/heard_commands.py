"""What the vehicle makes of the jet commands that it hears: which pressures they rest on, and how many it may miss.

A command echoes the counter of a Pressure frame, which repeats after 256 frames, in the classic set after 16. An echo
that stands still would look fresh again after that. So echoes are followed one by one: each is taken for the first
frame with its counter that is not older than the frame echoed before it. Where commands were interrupted there is
nothing to follow, and the newest frame with that counter is meant.

The limit of what may be missed is (m, k)-firm. The ECU judges the pressures that it misses in the same way
(`ecu.fail_safe`). It cannot see that its commands are lost, so the vehicle judges these by itself.
"""

from dataclasses import dataclass, replace
from typing import Final

from can_bridge.wire.messages import Mode
from contract.config.vehicle import VehicleConfig


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
        """Count a frame with this counter that was sent."""
        newest = counter
        if self.newest is not None:
            newest = self.newest + (counter - self.newest) % self.counter_period
        return replace(self, newest=newest, kept=(*self.kept, now_ns)[-self.counter_period :])

    def interrupted(self) -> "EchoTracker":
        """Forget the echo after commands stayed away, or came without an echo."""
        return replace(self, echoed=None)

    def received(self, counter: int) -> "EchoTracker":
        """Follow a command with this echo; without one to follow if it is of no frame that was sent."""
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


_NO_CONTROL: Final = (Mode.OFF, Mode.FAULT)


@dataclass(frozen=True, kw_only=True)
class CommandLosses:
    """Counts while the ECU has control, and latches at the limit.

    Attributes:
        window: latest periods that are judged together.
        limit: missed ones among them from which on control is given up.
        missed: of the latest periods under control, at most `window`, oldest first; none while the ECU has no control.
    """

    window: int
    limit: int
    missed: tuple[bool, ...] = ()
    is_latched: bool = False

    @classmethod
    def of(cls, config: VehicleConfig) -> "CommandLosses":
        """None so far."""
        return cls(window=config.loss_window, limit=config.loss_limit)

    def heard(self, mode: Mode) -> "CommandLosses":
        """Count a period with a command of this mode."""
        return replace(self, missed=() if mode in _NO_CONTROL else (*self.missed, False)[-self.window :])

    def lost(self) -> "CommandLosses":
        """Count a period without a command that can be used."""
        if not self.missed:
            return self
        missed = (*self.missed, True)[-self.window :]
        return replace(self, missed=missed, is_latched=self.is_latched or sum(missed) >= self.limit)

    def cleared(self) -> "CommandLosses":
        """Once the vehicle itself does not want control."""
        return replace(self, missed=(), is_latched=False)
