"""What every reader of logs yields, and what several of them read alike: text of any encoding, names, bytes."""

import io
import re
from collections.abc import Callable, Iterator
from datetime import datetime
from gzip import GzipFile
from typing import BinaryIO, Final, NamedTuple, cast

import can

from can_bridge.wire.frame import FD_LENGTHS
from can_bridge.wire.message_specs import SPECS

HEADER: Final = "header"
COMMENT: Final = "comment"
REQUEST: Final = "transmit request"
"""A node has asked for a frame to be sent: the frame itself is another entry, or never came."""
NOT_OURS: Final = "frame by a name that is not ours"
"""Of a log with names in place of identifiers."""
XL: Final = "CAN XL frame"

IDS: Final = {spec.name: spec.frame_id for spec in SPECS}
"""Identifiers of our messages, by the names that a log written with our DBC has for them."""
FD_IDS: Final = frozenset(spec.frame_id for spec in SPECS if spec.is_fd)

MOST_ID: Final = 0x1FFFFFFF
_PROTOCOL, _NO_ACK = 0x8, 0x20
ERROR_CLASSES: Final = {
    0x1: "transmit timeout",
    0x2: "arbitration lost",
    0x4: "controller",
    _PROTOCOL: "protocol",
    0x10: "transceiver",
    _NO_ACK: "no acknowledgement",
    0x40: "bus off",
    0x80: "bus error",
    0x100: "restarted",
    0x200: "error counters",
}
"""Names of the bits that say what an error frame reports, after Linux (linux/can/error.h), in its identifier."""

Binary = BinaryIO | GzipFile
"""An open file, packed or not."""
SinceEpoch = Callable[[datetime], float]
"""From a start that a file has in local time, without its zone, to s since the epoch."""


class Event(NamedTuple):
    """One or more lines, or objects of a binary file, that are no frame, by what they are."""

    name: str
    lines: int = 1


class CutOffError(Exception):
    """The end of a file is missing; the message says by what that shows."""


Entry = can.Message | Event


def error_class(message: can.Message) -> str:
    """What an error frame reports, in words."""
    names = [name for bit, name in ERROR_CLASSES.items() if message.arbitration_id & bit]
    return " and ".join(names) or "not stated"


def error_frame(time_s: float, channel: str, classes: int = 0) -> can.Message:
    """An error frame; of formats that do not state its class the identifier is 0."""
    return can.Message(timestamp=time_s, is_error_frame=True, arbitration_id=classes, channel=channel)


def data_frame(
    time_s: float,
    channel: str,
    frame_id: int,
    data: bytes,
    *,
    is_extended: bool,
    is_fd: bool = False,
    is_rx: bool = True,
    brs: bool = False,
    esi: bool = False,
) -> can.Message:
    """A data frame. Raises ValueError for an identifier that is none."""
    _check_id(frame_id)
    return can.Message(
        timestamp=time_s,
        arbitration_id=frame_id,
        is_extended_id=is_extended,
        is_fd=is_fd,
        is_rx=is_rx,
        bitrate_switch=brs,
        error_state_indicator=esi,
        dlc=len(data),
        data=data,
        channel=channel,
    )


def remote_frame(
    time_s: float, channel: str, frame_id: int, dlc: int, *, is_extended: bool, is_rx: bool = True
) -> can.Message:
    """A remote frame. Raises ValueError for an identifier that is none."""
    _check_id(frame_id)
    return can.Message(
        timestamp=time_s,
        arbitration_id=frame_id,
        is_extended_id=is_extended,
        is_remote_frame=True,
        is_rx=is_rx,
        dlc=dlc,
        channel=channel,
    )


def _check_id(frame_id: int) -> None:
    if not 0 <= frame_id <= MOST_ID:
        raise ValueError(f"identifier {frame_id:X}, must have at most 29 bits")


def length_of(code: int, *, is_fd: bool) -> int:
    """Bytes that a length code stands for; the codes 9 to 15 of a classic frame are 8 bytes (ISO 11898-1). Raises
    ValueError for a code that is none."""
    if not 0 <= code < len(FD_LENGTHS):
        raise ValueError(f"length code {code}, must be in 0..15")
    return FD_LENGTHS[code] if is_fd else min(code, 8)


def bytes_of(words: list[str], length: int, base: int = 16) -> bytes:
    """The first `length` words as bytes. Raises ValueError where they are fewer, or one is no byte: a hexadecimal byte
    has two digits, so that one cut in half is seen."""
    digits = re.compile("[0-9A-Fa-f]{2}" if base == 16 else "[0-9]{1,3}")
    there = [word for word in words[:length] if digits.fullmatch(word)]
    if len(there) < length:
        raise ValueError(f"{length} bytes announced, {len(there)} there")
    return bytes(int(word, base) for word in there)


class Lines:
    """The lines of a text log, numbered from 1, with their ends.

    Bytes that the encoding does not have are kept as escapes: in headers and comments they matter to no one, and a
    frame's line that has one is refused by its reader.

    Attributes:
        count: lines that hold anything, so far.
    """

    def __init__(self, file: Binary) -> None:
        self.count = 0
        self._file = file

    def __iter__(self) -> Iterator[tuple[int, str]]:
        raw = io.BufferedReader(cast(io.RawIOBase, self._file))
        encoding = _encoding(raw.peek(4)[:4])
        errors = "surrogateescape" if encoding.startswith("utf-8") else "replace"
        for number, line in enumerate(io.TextIOWrapper(raw, encoding=encoding, errors=errors), 1):
            if line.strip():
                self.count += 1
                yield number, line


def _encoding(head: bytes) -> str:
    """By the mark of the byte order, or by the zeros between the characters of UTF-16."""
    if head[:3] == b"\xef\xbb\xbf":
        return "utf-8-sig"
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    if len(head) == 4 and 0 not in (head[0], head[2]) and head[1] == head[3] == 0:
        return "utf-16-le"
    return "utf-16-be" if len(head) == 4 and head[0] == head[2] == 0 and head[1] and head[3] else "utf-8"
