"""The parts that the formats of logs and measurements share: entries, named channels, encodings, names, bytes."""

import io
import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from gzip import GzipFile
from typing import BinaryIO, Final, NamedTuple, cast

import can

from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, MAX_EXTENDED_ID
from can_bridge.wire.message_specs import SPECS
from contract.arrays import Array

HEADER_LINE: Final = "header"
COMMENT: Final = "comment"
REQUEST: Final = "transmit request"
"""Event name of a node's request to send a frame. The frame itself is another entry, or was never sent."""
NOT_OURS: Final = "frame with a name that stillwake does not use"
"""Event name of a frame whose line has no identifier, only a message name that is not in our DBC."""
XL: Final = "CAN XL frame"

IDS: Final = {spec.name: spec.frame_id for spec in SPECS}
"""Identifiers of our messages, by their names in a log that was written with our DBC."""
FD_IDS: Final = frozenset(spec.frame_id for spec in SPECS if spec.is_fd)

FD_FRAME, BRS, ESI = 1, 2, 4
"""Bits that describe a frame: CAN FD format, bit-rate switch, error-passive sender."""
PROTOCOL, NO_ACK = 0x8, 0x20
_ERROR_CLASSES: Final = (
    *("transmit timeout", "arbitration lost", "controller", "protocol", "transceiver"),
    *("no acknowledgement", "bus off", "bus error", "restarted", "error counters"),
)
"""Names of the bits in an error frame's identifier, from the lowest, one for each class (linux/can/error.h)."""

_BYTE: Final = {16: re.compile("[0-9A-Fa-f]{2}"), 10: re.compile("[0-9]{1,3}")}

Binary = BinaryIO | GzipFile
"""An open file, plain or gzip."""
SinceEpoch = Callable[[datetime], float]
"""A function that converts a local start time to s since the epoch, for files that do not state their time zone."""


class LogEvent(NamedTuple):
    """An entry that is not a frame. It stands for `lines` lines (in a binary file: objects) of the kind `name`."""

    name: str
    lines: int = 1


class CutOffError(Exception):
    """The error for a file whose end is missing; its message states how the reader detected this."""


Entry = can.Message | LogEvent
Ident = tuple[int, bool]
"""An identifier: its number, and whether it has 29 bits."""


def error_class(message: can.Message) -> str:
    names = [name for bit, name in enumerate(_ERROR_CLASSES) if message.arbitration_id >> bit & 1]
    return " and ".join(names) or "not stated"


def error_frame(time_s: float, channel: str, classes: int = 0) -> can.Message:
    """Return an error frame. `classes` has the bits of the error classes; 0 for a format that does not state them."""
    return can.Message(timestamp=time_s, is_error_frame=True, arbitration_id=classes, channel=channel)


def frame(
    time_s: float, channel: str, ident: Ident, data: bytes | None, *, fd: int = 0, is_rx: bool = True, dlc: int = 0
) -> can.Message:
    """Return a data frame, or a remote frame of `dlc` bytes if `data` is None. `fd` has the bits `FD_FRAME`, `BRS` and
    `ESI`; 0 means classic CAN. Raises ValueError for an identifier out of range."""
    if not 0 <= ident[0] <= MAX_EXTENDED_ID:
        raise ValueError(f"identifier {ident[0]:X} must have at most 29 bits")
    return can.Message(
        timestamp=time_s,
        arbitration_id=ident[0],
        is_extended_id=ident[1],
        is_remote_frame=data is None,
        is_fd=bool(fd & FD_FRAME),
        is_rx=is_rx,
        bitrate_switch=bool(fd & BRS),
        error_state_indicator=bool(fd & ESI),
        dlc=dlc if data is None else len(data),
        data=data,
        channel=channel,
    )


def length_of(code: int, *, is_fd: bool) -> int:
    """Return the bytes for a length code (0..15, else ValueError); classic codes 9 to 15 mean 8 (ISO 11898-1)."""
    if not 0 <= code < len(FD_LENGTHS):
        raise ValueError(f"length code {code} must be in 0..15")
    return FD_LENGTHS[code] if is_fd else min(code, 8)


def check_length(length: int, *, is_fd: bool) -> int:
    """Return the length unchanged. Raises ValueError if no frame can have this length."""
    if length not in (FD_LENGTHS if is_fd else CLASSIC_LENGTHS):
        raise ValueError(f"no {'CAN FD' if is_fd else 'classic CAN'} frame has {length} bytes")
    return length


def bytes_of(words: list[str], length: int, base: int = 16) -> bytes:
    """Return the first `length` words as bytes. Raises ValueError if there are fewer words, or if a word is not a byte.
    A hexadecimal byte must have two digits, so that a truncated byte is detected."""
    there = [word for word in words[:length] if _BYTE[base].fullmatch(word)]
    if len(there) < length:
        raise ValueError(f"{length} bytes are announced, but {len(there)} are present")
    return bytes(int(word, base) for word in there)


class Lines:
    """The lines of a text log except empty lines, with their line ends. `number` is the present line's number, from 1;
    after the last line it is 0. Escape characters replace bytes that are invalid in the encoding. Headers and comments
    may contain escape characters; readers reject a frame's line that contains an escape character."""

    def __init__(self, file: Binary) -> None:
        self.number, self._raw = 0, io.BufferedReader(cast(io.RawIOBase, file))

    def __iter__(self) -> Iterator[str]:
        encoding = json.detect_encoding(self._raw.peek(4)[:4])
        errors = "surrogateescape" if encoding.startswith("utf-8") else "replace"
        for line in io.TextIOWrapper(self._raw, encoding=encoding, errors=errors):
            self.number += 1
            if line.strip():
                yield line
        self.number = 0


class NamedChannel(NamedTuple):
    """A quantity with one value for each time of its group.

    Attributes:
        unit: unit as in `contract/stillwake.dbc`; empty if there is none.
        values: values at the group's n times, (n,); NaN where there is no value.
        words: names of the values, for an enumeration; empty for a number.
    """

    name: str
    unit: str
    values: Array
    words: Mapping[int, str] = {}

    @property
    def identifier(self) -> str:
        """The name with its unit, for formats that have no field for units: Pressure0_Pa, Speed_m_per_s."""
        return re.sub(r"\W+", "_", f"{self.name} {self.unit.replace('/', '_per_')}".strip())


@dataclass(frozen=True, kw_only=True, eq=False)
class ChannelGroup:
    """A group of channels with common times.

    Attributes:
        name: name of the message, or of a part of a run; unique in a file.
        times_s: the n times of the values in s, (n,), not decreasing.
    """

    name: str
    times_s: Array
    channels: tuple[NamedChannel, ...]
    comment: str = ""
