"""One end of an ISO-TP connection (ISO 15765-2:2016), as a state machine whose inputs are the time and received frames.

The endpoint has no clock and no bus: the caller passes the time and the received frames, and sends the frames that
`poll` returns. Any received data lead to a message, to an answer or to nothing, never to an exception.
"""

from collections import deque
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

from can_bridge.isotp import control_info
from can_bridge.isotp.control_info import MAX_MESSAGE, Consecutive, First, FlowControl, FlowStatus, Single
from can_bridge.wire.frame import Frame


@dataclass(frozen=True, kw_only=True)
class IsoTpSettings:
    """The settings of one end of a connection.

    Attributes:
        receive_id, send_id: identifiers of the frames from the other end and of the frames of this end.
        frame_length: largest data length of a sent frame in bytes: 8, or a greater CAN FD length if `is_fd`.
        is_fd: whether to send CAN FD frames; CAN FD frames and classic frames are received.
        block_size: number of frames after which the other end must wait for this end's flow control, 0 for never.
        separation_code: code byte of the least time between the frames that the other end sends.
        queue: largest number of messages that wait to be sent, and also of received messages that wait for `take`.
        burst: largest number of frames of one `poll`, so that a controller's transmit buffers do not overflow.
        wait_ns: longest wait for the other end's flow control (N_Bs) or next frame (N_Cr), in ns.
        max_waits: largest number of consecutive WAIT answers of the other end.
    """

    receive_id: int
    send_id: int
    is_extended: bool = False
    frame_length: int = 64
    is_fd: bool = True
    block_size: int = 0
    separation_code: int = 0
    queue: int = 8
    burst: int = 8
    wait_ns: int = 1_000_000_000
    max_waits: int = 100


class _Reception:
    """The reception of at most one message at a time."""

    def __init__(self, settings: IsoTpSettings) -> None:
        self._settings = settings
        self._wanted = self._frame_length = self._frames = self._deadline_ns = 0
        self._data = bytearray()

    @property
    def is_running(self) -> bool:
        return self._wanted > 0

    def abort(self) -> None:
        self._wanted = 0
        self._data.clear()

    def tick(self, now_ns: int) -> None:
        """Drop a message whose next frame is overdue."""
        if now_ns > self._deadline_ns:
            self.abort()

    def first(self, now_ns: int, part: First) -> FlowStatus:
        """Drop an incomplete message, and begin to receive a new message; return the flow status of the answer."""
        self.abort()
        if part.length > MAX_MESSAGE:
            return FlowStatus.OVERFLOW
        self._wanted = part.length
        self._frame_length = part.frame_length
        self._data += part.data
        self._frames = 0
        self._deadline_ns = now_ns + self._settings.wait_ns
        return FlowStatus.CONTINUE

    def consecutive(self, now_ns: int, part: Consecutive) -> tuple[bytes | None, FlowStatus | None]:
        """Add the next part. Return the message if it is complete, and the flow status of an answer if one is due."""
        if part.number != (self._frames + 1) % control_info.SEQUENCE_NUMBERS:
            self.abort()
        if not self._wanted:
            return None, None
        missing = self._wanted - len(self._data)
        longest = self._frame_length - 1
        if not min(missing, longest) <= len(part.data) <= longest:
            # Only a message's last frame may be shorter than the first. The next frame's number ends the reception.
            return None, None
        self._data += part.data[:missing]
        self._frames += 1
        self._deadline_ns = now_ns + self._settings.wait_ns
        if len(self._data) == self._wanted:
            message = bytes(self._data)
            self.abort()
            return message, None
        block_size = self._settings.block_size
        return None, FlowStatus.CONTINUE if block_size and self._frames % block_size == 0 else None


class _State(Enum):
    IDLE = auto()
    READY = auto()
    """No frame of the message was sent yet."""
    WAITING = auto()
    """The receiver has not sent its flow control yet."""
    SENDING = auto()


class _Transmission:
    """The transmission of at most one message at a time."""

    def __init__(self, settings: IsoTpSettings) -> None:
        self._settings = settings
        self._state = _State.IDLE
        self.message = b""
        self._sent = self._number = self._left_in_block = self._waits = 0
        self._separation_ns = self._not_before_ns = self._deadline_ns = 0

    @property
    def is_running(self) -> bool:
        return self._state is not _State.IDLE

    def begin(self, message: bytes) -> None:
        self.message = message
        self._state = _State.READY

    def tick(self, now_ns: int) -> None:
        """Give up a message if the receiver's flow control is overdue."""
        if self._state is _State.WAITING and now_ns > self._deadline_ns:
            self._end()

    def flow(self, now_ns: int, part: FlowControl) -> None:
        """Process the receiver's flow control; ignore it unless the transmission is waiting for it."""
        if self._state is not _State.WAITING:
            return
        if part.status is FlowStatus.CONTINUE:
            self._state = _State.SENDING
            self._left_in_block = part.block_size
            self._separation_ns = part.separation_ns
            self._not_before_ns = now_ns
            self._waits = 0
        elif part.status is FlowStatus.WAIT and self._waits < self._settings.max_waits:
            self._waits += 1
            self._deadline_ns = now_ns + self._settings.wait_ns
        else:
            self._end()

    def next_frame(self, now_ns: int) -> bytes | None:
        if self._state is _State.READY:
            return self._beginning(now_ns)
        if self._state is not _State.SENDING or now_ns < self._not_before_ns:
            return None
        data = self.message[self._sent : self._sent + self._settings.frame_length - 1]
        frame = control_info.consecutive(self._number, data)
        self._sent += len(data)
        self._number = (self._number + 1) % control_info.SEQUENCE_NUMBERS
        self._not_before_ns = now_ns + self._separation_ns
        if self._sent == len(self.message):
            self._end()
        elif self._left_in_block:
            self._left_in_block -= 1
            if not self._left_in_block:
                self._wait(now_ns)
        return frame

    def _beginning(self, now_ns: int) -> bytes:
        length = self._settings.frame_length
        if len(self.message) <= control_info.capacity(length):
            frame = control_info.single(self.message)
            self._end()
            return frame
        frame = control_info.first(self.message, length)
        self._sent, self._number = length - 2, 1
        self._waits = 0
        self._wait(now_ns)
        return frame

    def _wait(self, now_ns: int) -> None:
        self._state = _State.WAITING
        self._deadline_ns = now_ns + self._settings.wait_ns

    def _end(self) -> None:
        self._state = _State.IDLE
        self.message = b""


KEPT_PLACES: Final = 2
"""Number of reserved places in the transmit queue, for a response-pending and the answer to the same request."""


class Endpoint:
    """An endpoint for messages of 1 to 4095 bytes, one at a time in each direction.

    Attributes:
        is_held: whether the latest message is still being processed; no message of several frames is then accepted.
    """

    def __init__(self, settings: IsoTpSettings) -> None:
        self._settings = settings
        self._reception = _Reception(settings)
        self._transmission = _Transmission(settings)
        self._answer: FlowStatus | None = None
        self._received: list[bytes] = []
        self._to_send = deque[bytes]()
        self.is_held = False

    @property
    def is_receiving(self) -> bool:
        return self._reception.is_running

    @property
    def is_sending(self) -> bool:
        """Whether a message is not yet sent completely."""
        return self._transmission.is_running or bool(self._to_send)

    @property
    def occupied(self) -> int:
        """The number of bytes of messages that are not yet sent completely."""
        return len(self._transmission.message) + sum(map(len, self._to_send))

    @property
    def is_full(self) -> bool:
        """Whether the queue has only the `KEPT_PLACES` reserved places left, or fewer."""
        return len(self._to_send) + KEPT_PLACES >= self._settings.queue

    def receive(self, now_ns: int, frame: Frame) -> None:
        """Process a frame from the bus; frames with other identifiers are ignored."""
        if (frame.frame_id, frame.is_extended) != (self._settings.receive_id, self._settings.is_extended):
            return
        self._tick(now_ns)
        part = control_info.parse(frame.data)
        if isinstance(part, Consecutive):
            message, answer = self._reception.consecutive(now_ns, part)
            if message is not None:
                self._keep(message)
            if answer is not None:
                self._answer = answer
        elif isinstance(part, First):
            self._answer = FlowStatus.OVERFLOW if self.is_held else self._reception.first(now_ns, part)
        elif isinstance(part, Single):
            self._reception.abort()
            self._keep(part.data)
        elif isinstance(part, FlowControl):
            self._transmission.flow(now_ns, part)

    def send(self, message: bytes) -> bool:
        """Queue a message for `poll`; return False if the queue is full. Raises ValueError for a wrong length."""
        if not 0 < len(message) <= MAX_MESSAGE:
            raise ValueError(f"the message has {len(message)} bytes: must have 1..{MAX_MESSAGE}")
        if len(self._to_send) == self._settings.queue:
            return False
        self._to_send.append(bytes(message))
        return True

    def poll(self, now_ns: int) -> list[Frame]:
        """Return the frames to be sent now: first the answer to the other end, then the messages of this end."""
        self._tick(now_ns)
        frames = list[Frame]()
        own, answer, self._answer = self._settings, self._answer, None
        if answer is not None and (answer is not FlowStatus.CONTINUE or self._reception.is_running):
            flow = control_info.flow(answer, block_size=own.block_size, separation_code=own.separation_code)
            frames.append(self._frame(now_ns, flow))
        while len(frames) < own.burst:
            if self._to_send and not self._transmission.is_running:
                self._transmission.begin(self._to_send.popleft())
            if (data := self._transmission.next_frame(now_ns)) is None:
                break
            frames.append(self._frame(now_ns, data))
        return frames

    def take(self) -> list[bytes]:
        """Return the messages completed since the last call, oldest first."""
        messages, self._received = self._received, []
        return messages

    def _tick(self, now_ns: int) -> None:
        self._reception.tick(now_ns)
        self._transmission.tick(now_ns)

    def _keep(self, message: bytes) -> None:
        if len(self._received) < self._settings.queue:
            self._received.append(message)

    def _frame(self, now_ns: int, data: bytes) -> Frame:
        own = self._settings
        return Frame(frame_id=own.send_id, data=data, timestamp_ns=now_ns, is_fd=own.is_fd, is_extended=own.is_extended)
