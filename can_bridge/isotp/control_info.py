"""The first bytes of a frame. They state which part of a message the frame contains (ISO 15765-2:2016, 9.6)."""

from bisect import bisect_left
from enum import IntEnum
from typing import Final, NamedTuple

from can_bridge.wire.frame import FD_LENGTHS

MAX_MESSAGE: Final = 4095
"""Largest message length in bytes that the 12-bit field of a first frame can state."""
CLASSIC_LENGTH: Final = 8
FRAME_LENGTHS: Final = tuple(length for length in FD_LENGTHS if length >= CLASSIC_LENGTH)
"""Data lengths in bytes that a transmitter may use for its frames."""
PADDING: Final = 0xCC
"""Padding byte that needs the fewest stuff bits (ISO 15765-2, section 10.4.2.2)."""
SEQUENCE_NUMBERS: Final = 16
"""Number of different sequence numbers; a sequence number has four bits."""

_SINGLE, _FIRST, _CONSECUTIVE, _FLOW = range(4)
_LARGEST_MILLISECONDS: Final = 0x7F
_NS_PER_MS: Final = 1_000_000


class FlowStatus(IntEnum):
    CONTINUE = 0
    WAIT = 1
    OVERFLOW = 2


class Single(NamedTuple):
    """A whole message in one frame."""

    data: bytes


class First(NamedTuple):
    """The beginning of a message; `frame_length` is the frame's data length, which the following frames also have."""

    length: int
    data: bytes
    frame_length: int


class Consecutive(NamedTuple):
    """The next part of a message; in the last frame `data` includes padding."""

    number: int
    data: bytes


class FlowControl(NamedTuple):
    """The receiver's answer: the number of frames before its next answer (0: all), and the time between frames."""

    status: FlowStatus | None
    block_size: int
    separation_ns: int


def parse(data: bytes) -> Single | First | Consecutive | FlowControl | None:
    """Return the message part or the flow control in a frame; None for a frame to be ignored. Never raises."""
    if not data:
        return None
    kind, low = data[0] >> 4, data[0] & 0xF
    if kind == _SINGLE:
        # In a frame of more than eight bytes the first length is 0, and the length has a byte of its own.
        at, length = (1, low) if len(data) <= CLASSIC_LENGTH else (2, 0 if low else data[1])
        return Single(data[at : at + length]) if 0 < length <= len(data) - at else None
    if kind == _FIRST and len(data) >= CLASSIC_LENGTH:
        at, length, least = 2, low << 8 | data[1], capacity(len(data)) + 1
        if length == 0:
            at, length, least = 6, int.from_bytes(data[2:6], "big"), MAX_MESSAGE + 1
        return First(length, data[at:], len(data)) if length >= least else None
    if kind == _CONSECUTIVE:
        return Consecutive(low, data[1:])
    if kind == _FLOW and len(data) >= 3:
        status = FlowStatus(low) if low <= FlowStatus.OVERFLOW else None
        return FlowControl(status, data[1], separation_ns(data[2]))
    return None


def separation_ns(code: int) -> int:
    """Return the least time between frames in ns; reserved codes mean the longest time (section 9.6.5.5)."""
    if code <= _LARGEST_MILLISECONDS:
        return code * _NS_PER_MS
    if 0xF1 <= code <= 0xF9:
        return (code - 0xF0) * _NS_PER_MS // 10
    return _LARGEST_MILLISECONDS * _NS_PER_MS


def capacity(frame_length: int) -> int:
    """Return the largest message length in bytes for a single frame of this length."""
    return frame_length - (1 if frame_length <= CLASSIC_LENGTH else 2)


def single(message: bytes) -> bytes:
    length = len(message)
    header = bytes([length]) if length < CLASSIC_LENGTH else bytes([0, length])
    return padded(header + message)


def first(message: bytes, frame_length: int) -> bytes:
    length = len(message)
    return bytes([_FIRST << 4 | length >> 8, length & 0xFF]) + message[: frame_length - 2]


def consecutive(number: int, data: bytes) -> bytes:
    return padded(bytes([_CONSECUTIVE << 4 | number]) + data)


def flow(status: FlowStatus, *, block_size: int = 0, separation_code: int = 0) -> bytes:
    return padded(bytes([_FLOW << 4 | status, block_size, separation_code]))


def padded(data: bytes) -> bytes:
    """Pad data of up to 64 bytes with `PADDING` to the next length that a frame can have, at least 8 bytes."""
    return data.ljust(FRAME_LENGTHS[bisect_left(FRAME_LENGTHS, len(data))], bytes([PADDING]))
