"""Faults that turn one frame into none, another one, or several, at once, and their injector."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Any, Literal

from can_bridge.bus.faults.fault import FrameFault
from can_bridge.bus.faults.injector import Injector
from can_bridge.wire.frame import Frame

Change = Callable[[Frame], list[Frame]]


class _FrameByFrame(Injector["SidedFault"]):
    """Passes each frame that the fault concerns, and that was sent or arrived in its span, through `change`. `acted`
    counts frames that came out otherwise than they went in."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._change = self._fault.change(self._random)

    def send(self, frame: Frame) -> None:
        """See `Bus.send`; what the frame turns into is sent."""
        for item in self._changed(frame, self._clock()) if self._fault.at == "send" else (frame,):
            self._bus.send(item)

    def receive_all(self) -> list[Frame]:
        """See `Bus.receive_all`; what the frames turn into."""
        received = self._bus.receive_all()
        if self._fault.at == "send":
            return received
        arrived = self._arrivals.of(received, self._clock())
        return [item for arrived_ns, frame in arrived for item in self._changed(frame, arrived_ns)]

    def _changed(self, frame: Frame, t_ns: int) -> list[Frame]:
        if not (self._fault.concerns(frame) and self._fault.is_active(t_ns)):
            return [frame]
        frames = self._change(frame)
        self.acted += frames != [frame]
        return frames


@dataclass(frozen=True, kw_only=True)
class SidedFault(FrameFault, ABC, section="sided_fault"):
    """A fault of single frames on one side of the port."""

    injector = _FrameByFrame

    at: Literal["send", "receive"] = "send"
    """What the node sends, and so all the others get, or what this node alone receives."""

    @abstractmethod
    def change(self, random: Random) -> Change:
        """What a frame turns into; all draws come from `random`."""
