"""What all faults have in common: when they act, and on which frames."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from random import Random
from typing import Annotated, Any, ClassVar, Final, TypeVar

from can_bridge.bus.faults.injector import Injector
from can_bridge.bus.interface import Bus
from can_bridge.wire.frame import Frame
from contract.config.rules import NonNegative, Rule, Settings, require

T = TypeVar("T", int, float)

Clock = Callable[[], int]
"""The time in ns since the start of the run: a simulated bus's time, or a monotonic clock's less what it began with."""

Probability = Annotated[T, Rule(wording="in [0, 1]", holds=lambda value: 0 <= value <= 1)]

NS: Final = 10**9


@dataclass(frozen=True, kw_only=True)
class Span(Settings, section="span"):
    """From start_s until before end_s of the clock; raises ConfigError for a parameter out of its bounds."""

    start_s: NonNegative[float] = 0.0
    end_s: float = inf

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.end_s >= self.start_s, self, "end_s", f"start_s = {self.start_s!r} or later")

    def is_active(self, now_ns: int) -> bool:
        """Whether the fault acts at this time."""
        return round(self.start_s * NS) <= now_ns and (self.end_s == inf or now_ns < round(self.end_s * NS))


@dataclass(frozen=True, kw_only=True)
class Instant(Span, section="instant"):
    """What happens once, at start_s; its text ends in @TIME."""


@dataclass(frozen=True, kw_only=True)
class Fault(Span, section="fault"):
    """What acts in a span on one port, by an injector of its own."""

    injector: ClassVar[type[Injector[Any]]]

    def around(self, bus: Bus, clock: Clock, random: Random) -> Injector[Any]:
        """The bus with this fault; all its draws come from `random`, which no one else may use."""
        return self.injector(bus, self, clock, random)


@dataclass(frozen=True, kw_only=True)
class FrameFault(Fault, section="frame_fault"):
    """A fault of single frames."""

    frame_ids: tuple[int, ...] = ()
    """Identifiers of the frames that it concerns; empty for all."""

    def concerns(self, frame: Frame) -> bool:
        """Whether the fault is meant for this frame."""
        return not self.frame_ids or frame.frame_id in self.frame_ids
