"""The common part of all faults: when and on which frames they act, and the bus that applies them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from random import Random
from typing import Annotated, Final, Literal

from can_bridge.bus.interface import HEALTHY, Bus, BusHealth
from can_bridge.wire.frame import Frame
from contract.config.rules import HUGE, NonNegative, Rule, Settings, require

NowNs = Callable[[], int]
"""A function that returns the time in ns since the start of the run, from a simulated bus or a monotonic clock."""

Probability = Annotated[float, Rule(wording="in [0, 1]", holds=lambda value: 0 <= value <= 1)]

NS: Final = 10**9
Change = Callable[[Frame], list[Frame]]
Send = Callable[[Frame], None]
Receive = Callable[[], list[Frame]]


class WrappedBus:
    def __init__(self, beneath: Bus) -> None:
        self._bus = beneath

    def send(self, frame: Frame) -> None:
        self._bus.send(frame)

    def receive_all(self) -> list[Frame]:
        return self._bus.receive_all()

    def health(self) -> BusHealth:
        """Return the health of the wrapped bus's CAN controller; `HEALTHY` if that bus reports no health."""
        health: Callable[[], BusHealth] | None = getattr(self._bus, "health", None)
        return HEALTHY if health is None else health()


@dataclass(frozen=True, kw_only=True)
class Span(Settings, section="span"):
    """A time span from `start_s` up to, not including, `end_s`. Raises ConfigError for a parameter out of bounds."""

    start_s: NonNegative[float] = 0.0
    end_s: float = inf

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.start_s <= self.end_s <= HUGE or self.end_s == inf, self, "end_s", f"in {self.start_s}..{HUGE:g}")

    def is_active(self, now_ns: int) -> bool:
        return round(self.start_s * NS) <= now_ns and (self.end_s == inf or now_ns < round(self.end_s * NS))


@dataclass(frozen=True, kw_only=True)
class Instant(Span, section="instant"):
    """An event that happens once, at `start_s`. Its text form (`can_bridge.bus.faults.text`) ends in @TIME."""


@dataclass(frozen=True, kw_only=True)
class BusFault(Span, ABC, section="fault"):
    """A fault that acts on one port during a time span."""

    @abstractmethod
    def acting(self, port: "Injector") -> tuple[Send, Receive]:
        """Return this port's functions to send and to receive. They count the fault's effects in `port.acted`."""


class Injector(WrappedBus):
    """A port with one fault. `acted` counts the fault's effects, which the fault's class defines."""

    def __init__(self, bus: Bus, fault: "BusFault", clock: NowNs, random: Random) -> None:
        """Apply a fault to a bus. The fault's span refers to the time of `clock`; nothing else may use `random`."""
        super().__init__(bus)
        self.beneath, self.clock, self.random = bus, clock, random
        self.acted = 0
        self._looked_ns = self._latest_ns = 0
        self._send, self._receive = fault.acting(self)

    def arrived(self, now_ns: int) -> list[tuple[int, Frame]]:
        """Return the frames that the wrapped bus received since the previous call, each with its time of arrival in ns.
        This time is the frame's time stamp if the stamp lies between the previous call and this call, otherwise the
        time of this call. No time is earlier than the time of a frame that was returned before."""
        arrived: list[tuple[int, Frame]] = []
        for frame in self.beneath.receive_all():
            stamp_ns = frame.timestamp_ns
            # The bus returns frames in the order of their arrival, which need not be the order of their time stamps.
            self._latest_ns = max(self._latest_ns, stamp_ns if self._looked_ns <= stamp_ns <= now_ns else now_ns)
            arrived.append((self._latest_ns, frame))
        self._looked_ns = now_ns
        return arrived

    def send(self, frame: Frame) -> None:
        self._send(frame)

    def receive_all(self) -> list[Frame]:
        return self._receive()


@dataclass(frozen=True, kw_only=True)
class FrameFault(BusFault, section="frame_fault"):
    frame_ids: tuple[int, ...] = ()
    """Identifiers of the frames on which the fault acts; empty for all frames."""

    def concerns(self, frame: Frame) -> bool:
        return not self.frame_ids or frame.frame_id in self.frame_ids


@dataclass(frozen=True, kw_only=True)
class SidedFault(FrameFault, section="sided_fault"):
    """A fault that acts on single frames in one direction."""

    at: Literal["send", "receive"] = "send"
    """Direction of the changed frames: "send" changes them for all receivers, "receive" for this node alone."""

    @abstractmethod
    def change(self, random: Random) -> Change:
        """Return a function that replaces a frame by a list of frames, with all random numbers from `random`."""

    def acting(self, port: Injector) -> tuple[Send, Receive]:
        """Replace the frames of one direction in the span. `acted` counts the frames changed, lost or copied."""
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
    """A port with faults, built by `wrap`. `injectors` has one injector for each fault, in the order of the faults."""

    def __init__(self, bus: Bus, injectors: Sequence[Injector]) -> None:
        super().__init__(injectors[-1] if injectors else bus)
        self.injectors = tuple(injectors)


def wrap(bus: Bus, faults: Sequence[BusFault], clock: NowNs, *, seed: int = 0, first: int = 0) -> FaultyBus:
    """Return the port with these faults applied to it.

    Args:
        faults: faults in order from the bus to the node: the first acts first on received and last on sent frames.
        clock: returns the present time in ns; the spans of the faults refer to this time.
        seed: random seed; equal faults, frames, times and seeds give equal results. Each fault draws for itself.
        first: number of faults that earlier calls applied to this port, so that no random sequence is used twice.
    """
    injectors: list[Injector] = []
    for place, fault in enumerate(faults, first):
        random = Random(f"{seed} {place} {fault.section}")
        injectors.append(Injector(injectors[-1] if injectors else bus, fault, clock, random))
    return FaultyBus(bus, injectors)
