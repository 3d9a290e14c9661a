"""The sender of a protected message: it builds numbered frames from data."""

from dataclasses import dataclass

from can_bridge.e2e.profiles import profile_of
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import MessageSpec


@dataclass(frozen=True, kw_only=True)
class SenderState:
    """The sender's state for one message: the next frame's counter."""

    counter: int = 0

    def next(self, spec: MessageSpec) -> "SenderState":
        return SenderState(counter=(self.counter + 1) % profile_of(spec).counter_period)


def protected_frame(state: SenderState, data: bytes, *, spec: MessageSpec, now_ns: int) -> Frame:
    """Return the next frame of a message, with data from the message's `emit`. For a secured message, the frame has
    only the protected part; `can_bridge.secoc.securing.secured` adds the rest. Raises ValueError for a wrong length."""
    if len(data) != spec.protected:
        raise ValueError(f"{spec.name} has {len(data)} bytes: must have {spec.protected}")
    protected = profile_of(spec).protect(data, data_id=spec.data_id, counter=state.counter)
    return Frame(frame_id=spec.frame_id, data=protected, timestamp_ns=now_ns, is_fd=spec.is_fd)


class E2eSender:
    def __init__(self, spec: MessageSpec) -> None:
        self.spec = spec
        self.state = SenderState()

    def frame(self, data: bytes, *, now_ns: int) -> Frame:
        frame = protected_frame(self.state, data, spec=self.spec, now_ns=now_ns)
        self.state = self.state.next(self.spec)
        return frame
