"""The vehicle's checks on the jet commands that it receives: the age of their pressures, and the number of missed
commands.

A command repeats ("echoes") the counter of the Pressure frame from which it was computed. The counter repeats after 256
frames, or after 16 frames in the classic message set, so an unchanged echo would look fresh again after that time. The
vehicle therefore assigns each echo to the first frame that has the echoed counter and is not older than the previously
echoed frame. After an interruption there is no previous echo; then the vehicle assigns the echo to the newest
frame with that counter.

The limit of missed commands is (m, k)-firm: it is reached if m of the latest k commands are missed. The ECU checks
missed pressures in the same way (`ecu.fail_safe`). The ECU cannot detect that its commands are lost, so the vehicle
counts missed commands itself.
"""

from dataclasses import dataclass, replace
from typing import Final

from can_bridge.wire.messages import Mode
from contract.config.vehicle import VehicleConfig


@dataclass(frozen=True, kw_only=True)
class EchoTracker:
    """An immutable record of sent Pressure frames and of the last echo. The first frame's number is its counter; from
    frame to frame the number increases by the counters' difference.

    Attributes:
        kept: sending times in ns of the latest frames, newest last; at most `counter_period` frames.
        newest: number of the newest frame; None before the first frame.
        echoed: number of the frame echoed last; None before the first echo, and after an interruption or wrong echo.
    """

    counter_period: int
    kept: tuple[int, ...] = ()
    newest: int | None = None
    echoed: int | None = None

    def sent(self, counter: int, now_ns: int) -> "EchoTracker":
        """Record a sent frame with this counter."""
        newest = counter
        if self.newest is not None:
            newest = self.newest + (counter - self.newest) % self.counter_period
        return replace(self, newest=newest, kept=(*self.kept, now_ns)[-self.counter_period :])

    def interrupted(self) -> "EchoTracker":
        """Delete the last echo, because commands were missing or contained no echo."""
        return replace(self, echoed=None)

    def received(self, counter: int) -> "EchoTracker":
        """Record a command's echo; if no sent frame can have this counter, delete the previous echo."""
        if self.newest is None:
            return self
        oldest = self.newest - len(self.kept) + 1 if self.echoed is None else self.echoed
        number = oldest + (counter - oldest) % self.counter_period
        return replace(self, echoed=number if number <= self.newest else None)

    @property
    def age(self) -> int | None:
        """Number of frames sent since the frame that was echoed last; None without an echo."""
        return None if self.newest is None or self.echoed is None else self.newest - self.echoed

    @property
    def sampled_ns(self) -> int | None:
        """Sending time in ns of the frame echoed last; None without an echo, or if the frame is no longer stored."""
        age = self.age
        return self.kept[-1 - age] if age is not None and age < len(self.kept) else None


_NO_CONTROL: Final = (Mode.OFF, Mode.FAULT)


@dataclass(frozen=True, kw_only=True)
class CommandLosses:
    """A count of missed commands while the ECU is in control. It latches at `limit` missed periods within `window`.

    Attributes:
        missed: whether the command was missed in each of the latest periods in which the ECU was in control, at most
            `window` periods, oldest first; empty while the ECU is not in control.
    """

    window: int
    limit: int
    missed: tuple[bool, ...] = ()
    is_latched: bool = False

    @classmethod
    def of(cls, config: VehicleConfig) -> "CommandLosses":
        """Return a count at zero."""
        return cls(window=config.loss_window, limit=config.loss_limit)

    def heard(self, mode: Mode) -> "CommandLosses":
        """Count a period in which a command in this mode arrived."""
        return replace(self, missed=() if mode in _NO_CONTROL else (*self.missed, False)[-self.window :])

    def lost(self) -> "CommandLosses":
        """Count a period without a usable command."""
        if not self.missed:
            return self
        missed = (*self.missed, True)[-self.window :]
        return replace(self, missed=missed, is_latched=self.is_latched or sum(missed) >= self.limit)

    def cleared(self) -> "CommandLosses":
        """Clear the count and its latch, because the vehicle does not request control."""
        return replace(self, missed=(), is_latched=False)
