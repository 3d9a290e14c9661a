"""What all faults have in common: when they act and on which frames, and the bus around a bus where they do."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import inf
from random import Random
from typing import Annotated, Final, Literal, TypeVar

from can_bridge.bus.interface import HEALTHY, Bus, BusHealth
from can_bridge.wire.frame import Frame
from contract.config.rules import NonNegative, Rule, Settings, require

T = TypeVar("T", int, float)

NowNs = Callable[[], int]
"""The time in ns since the start of the run: a simulated bus's time, or a monotonic clock's less what it began with."""

Probability = Annotated[T, Rule(wording="in [0, 1]", holds=lambda value: 0 <= value <= 1)]

NS: Final = 10**9
Change = Callable[[Frame], list[Frame]]
Send = Callable[[Frame], None]
Receive = Callable[[], list[Frame]]


class WrappedBus:
    """Passes everything on to the bus beneath."""

    def __init__(self, beneath: Bus) -> None:
        self._bus = beneath

    def send(self, frame: Frame) -> None:
        """See `Bus.send`."""
        self._bus.send(frame)

    def receive_all(self) -> list[Frame]:
        """See `Bus.receive_all`."""
        return self._bus.receive_all()

    def health(self) -> BusHealth:
        """The health of the CAN controller beneath; healthy if the bus does not know it."""
        health: Callable[[], BusHealth] | None = getattr(self._bus, "health", None)
        return HEALTHY if health is None else health()


class FrameArrivals:
    """Tells when frames arrived: at their time stamp, if that lies between the node's last two looks at the bus, as it
    does where stamps and looks have one clock; otherwise at the look that found them. Never before the frame ahead.
    """

    def __init__(self) -> None:
        self._looked_ns = 0
        self._latest_ns = 0

    def of(self, frames: Iterable[Frame], now_ns: int) -> list[tuple[int, Frame]]:
        """The frames found now, each with the time of its arrival."""
        arrived: list[tuple[int, Frame]] = []
        for frame in frames:
            stamp_ns = frame.timestamp_ns
            # The bus returns the oldest first, whatever their stamps are.
            self._latest_ns = max(self._latest_ns, stamp_ns if self._looked_ns <= stamp_ns <= now_ns else now_ns)
            arrived.append((self._latest_ns, frame))
        self._looked_ns = now_ns
        return arrived


@dataclass(frozen=True, kw_only=True)
class Span(Settings, section="span"):
    """A span from start_s until before end_s of the clock; raises ConfigError for a parameter out of its bounds."""

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
class BusFault(Span, ABC, section="fault"):
    """What acts in a span on one port."""

    @abstractmethod
    def acting(self, port: "Injector") -> tuple[Send, Receive]:
        """How the port sends and receives with this fault, from its power-on; `port.acted` is to be counted."""


class Injector(WrappedBus):
    """A port with one fault. `acted` counts how often the fault did something; each fault defines what it counts."""

    def __init__(self, bus: Bus, fault: "BusFault", clock: NowNs, random: Random) -> None:
        """Put a fault around a bus.

        Args:
            clock: the time in ns that the fault's span refers to.
            random: all of the fault's draws come from it; no one else may use it.
        """
        super().__init__(bus)
        self.beneath, self.clock, self.random = bus, clock, random
        self.acted = 0
        self._arrivals = FrameArrivals()
        self._send, self._receive = fault.acting(self)

    def arrived(self, now_ns: int) -> list[tuple[int, Frame]]:
        """What the bus beneath received since the last look, each frame with the time of its arrival."""
        return self._arrivals.of(self.beneath.receive_all(), now_ns)

    def send(self, frame: Frame) -> None:
        """See `Bus.send`, with the fault."""
        self._send(frame)

    def receive_all(self) -> list[Frame]:
        """See `Bus.receive_all`, with the fault."""
        return self._receive()


@dataclass(frozen=True, kw_only=True)
class FrameFault(BusFault, section="frame_fault"):
    """A fault of single frames."""

    frame_ids: tuple[int, ...] = ()
    """Identifiers of the frames that it concerns; empty for all."""

    def concerns(self, frame: Frame) -> bool:
        """Whether the fault is meant for this frame."""
        return not self.frame_ids or frame.frame_id in self.frame_ids


@dataclass(frozen=True, kw_only=True)
class SidedFault(FrameFault, section="sided_fault"):
    """A fault of single frames on one side of the port."""

    at: Literal["send", "receive"] = "send"
    """What the node sends, and so all the others get, or what this node alone receives."""

    @abstractmethod
    def change(self, random: Random) -> Change:
        """What a frame turns into; all draws come from `random`."""

    def acting(self, port: Injector) -> tuple[Send, Receive]:
        """See `BusFault.acting`: frames of the one side that were sent or arrived in the span turn into others. `acted`
        counts those that came out otherwise than they went in."""
        change = self.change(port.random)

        def changed(frame: Frame, t_ns: int) -> list[Frame]:
            if not (self.concerns(frame) and self.is_active(t_ns)):
                return [frame]
            frames = change(frame)
            port.acted += frames != [frame]
            return frames

        def send(frame: Frame) -> None:
            for item in changed(frame, port.clock()):
                port.beneath.send(item)

        def receive() -> list[Frame]:
            return [item for at_ns, frame in port.arrived(port.clock()) for item in changed(frame, at_ns)]

        return (send, port.beneath.receive_all) if self.at == "send" else (port.beneath.send, receive)


class FaultyBus(WrappedBus):
    """A port with faults; made by `wrap`. `injectors` has one for each fault, in the order of the faults; read `acted`
    there."""

    def __init__(self, bus: Bus, injectors: Sequence[Injector]) -> None:
        super().__init__(injectors[-1] if injectors else bus)
        self.injectors = tuple(injectors)


def wrap(bus: Bus, faults: Sequence[BusFault], clock: NowNs, *, seed: int = 0, first: int = 0) -> FaultyBus:
    """The port with these faults around it.

    Args:
        faults: from the wire to the node: a received frame meets the first one first, a sent frame the last one.
        clock: the time in ns that the faults' spans refer to.
        seed: same faults, frames, times and seed: same outcome. Each fault draws from a generator of its own, so that
            the draws of one do not depend on what another does.
        first: place of the first fault, where others stand before it that were wrapped before.
    """
    injectors: list[Injector] = []
    for place, fault in enumerate(faults, first):
        random = Random(f"{seed} {place} {fault.section}")
        injectors.append(Injector(injectors[-1] if injectors else bus, fault, clock, random))
    return FaultyBus(bus, injectors)
