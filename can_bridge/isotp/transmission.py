"""Sending one message in frames, as fast as its receiver allows."""

from enum import Enum, auto

from can_bridge.isotp import control_info
from can_bridge.isotp.control_info import SEQUENCE_NUMBERS, Flow, FlowStatus
from can_bridge.isotp.settings import IsoTpSettings


class _State(Enum):
    IDLE = auto()
    READY = auto()
    """Nothing of the message was sent yet."""
    WAITING = auto()
    """For flow control."""
    SENDING = auto()


class Transmission:
    """At most one message under way.

    Attributes:
        aborted: messages that were begun and not ended.
    """

    def __init__(self, settings: IsoTpSettings) -> None:
        self._settings = settings
        self._state = _State.IDLE
        self._message = b""
        self._sent = 0
        self._number = 0
        self._block_size = 0
        self._left_in_block = 0
        self._separation_ns = 0
        self._not_before_ns = 0
        self._deadline_ns = 0
        self._waits = 0
        self.aborted = 0

    @property
    def is_running(self) -> bool:
        return self._state is not _State.IDLE

    @property
    def length(self) -> int:
        """Bytes of the message under way; 0 without one."""
        return len(self._message)

    def begin(self, message: bytes) -> None:
        """Take a message; only while none is under way."""
        self._message = message
        self._state = _State.READY

    def tick(self, now_ns: int) -> None:
        """Give up a message whose flow control is overdue."""
        if self._state is _State.WAITING and now_ns > self._deadline_ns:
            self._abort()

    def flow(self, now_ns: int, part: Flow) -> None:
        """The receiver's answer; ignored while none is due."""
        if self._state is not _State.WAITING:
            return
        if part.status is FlowStatus.CONTINUE:
            self._state = _State.SENDING
            self._left_in_block = self._block_size = part.block_size
            self._separation_ns = part.separation_ns
            self._not_before_ns = now_ns
            self._waits = 0
        elif part.status is FlowStatus.WAIT and self._waits < self._settings.max_waits:
            self._waits += 1
            self._deadline_ns = now_ns + self._settings.n_bs_ns
        else:
            self._abort()

    def next_frame(self, now_ns: int) -> bytes | None:
        """Data of the frame that may be sent now, if one may."""
        if self._state is _State.READY:
            return self._beginning(now_ns)
        if self._state is not _State.SENDING or now_ns < self._not_before_ns:
            return None
        data = self._message[self._sent : self._sent + self._settings.frame_length - 1]
        frame = control_info.consecutive(self._number, data)
        self._sent += len(data)
        self._number = (self._number + 1) % SEQUENCE_NUMBERS
        self._not_before_ns = now_ns + self._separation_ns
        if self._sent == len(self._message):
            self._end()
        elif self._left_in_block:
            self._left_in_block -= 1
            if not self._left_in_block:
                self._wait(now_ns)
        return frame

    def _beginning(self, now_ns: int) -> bytes:
        length = self._settings.frame_length
        if len(self._message) <= control_info.capacity(length):
            frame = control_info.single(self._message)
            self._end()
            return frame
        frame = control_info.first(self._message, length)
        self._sent, self._number = length - 2, 1
        self._waits = 0
        self._wait(now_ns)
        return frame

    def _wait(self, now_ns: int) -> None:
        self._state = _State.WAITING
        self._deadline_ns = now_ns + self._settings.n_bs_ns

    def _abort(self) -> None:
        self.aborted += 1
        self._end()

    def _end(self) -> None:
        self._state = _State.IDLE
        self._message = b""
