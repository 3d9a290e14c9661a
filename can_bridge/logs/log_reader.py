"""Recorded CAN traffic, whatever wrote it: candump (.log), Vector ASC and BLF, PEAK TRC.

python-can reads the files; what it would pass over in silence is an error here: a file that was cut off, and a frame
with fewer bytes than its length. Times are those of the file: since the epoch, but of an ASC since its beginning.
"""

import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import can
from can.util import dlc2len

from contract.errors import BusError

SUFFIXES: Final = (".log", ".asc", ".blf", ".trc")

GREATEST_TIME_S: Final = 2**63 / 1e9
"""What 64 bits of nanoseconds hold: 292 years on both sides of the epoch."""

_BLF_SIZE: Final = struct.Struct("<4s 12x Q")
"""Signature, and the file's size at byte 16: what python-can and Vector's binlog write when they close it."""
_ASC_BEGIN: Final = b"begin triggerblock"
_ASC_END: Final = b"end triggerblock"
_HEAD: Final = 4096
"""Bytes of an ASC in which a trigger block that spans it begins."""
_WIDE_ID: Final = re.compile(rb"\s([0-9A-Fa-f]{9,})#")
"""In a candump; python-can cuts it to 29 bits, or takes it for an error frame."""


def check_suffix(path: Path) -> None:
    """Refuse what no reader or writer knows by its name. Raises BusError for another ending."""
    if path.suffix.lower() not in SUFFIXES:
        raise BusError(
            f"{path}: a log must end in {', '.join(SUFFIXES)}; `python -m can.logconvert` makes one of another format"
        )


def read_messages(path: Path) -> Iterator[can.Message]:
    """The messages of a log in the order of the file, as python-can reads them; timestamps in s. Raises BusError naming
    the file, if it is not there, of another kind, or damaged, after what could be read."""
    check_suffix(path)
    if not path.is_file():
        raise BusError(f"{path}: {'is a directory, must be a log' if path.is_dir() else 'there is no such file'}")
    before: can.Message | None = None
    try:
        cut_off = _is_cut_off(path)
        with can.LogReader(path) as reader:
            for number, message in enumerate(reader, 1):
                if path.suffix.lower() == ".trc" and message.is_fd and message.error_state_indicator:
                    # It takes PEAK's types FE (error state) and BI (with bit-rate switch, too) for each other.
                    message.bitrate_switch = not message.bitrate_switch
                if before is not None:
                    yield before
                before = _sound(message, number)
    except Exception as error:
        raise BusError(f"{path}: cannot be read as a CAN log ({error or type(error).__name__})") from error
    if cut_off:
        # The last frame may be a part of one that was longer.
        raise BusError(f"{path}: is cut off: {cut_off}")
    if before is not None:
        yield before


def _sound(message: can.Message, number: int) -> can.Message:
    """The message, with what python-can's readers get wrong put right. Raises ValueError for missing bytes, or a time
    that is none."""
    if not abs(message.timestamp) <= GREATEST_TIME_S:
        raise ValueError(f"frame {number}: time {message.timestamp} s, must be within {GREATEST_TIME_S:g} s")
    if message.is_error_frame:
        return message
    if message.is_fd and message.is_remote_frame:
        # CAN FD has no remote frames: so its ASC reader takes a frame without data.
        message.is_remote_frame, message.dlc = False, 0
    if message.is_fd and message.dlc != len(message.data) and message.dlc < 16:
        # Its TRC reader leaves the length code where the length belongs.
        message.dlc = dlc2len(message.dlc)
    if not message.is_remote_frame and message.dlc != len(message.data):
        raise ValueError(f"frame {number}: {message.dlc} bytes announced, {len(message.data)} there")
    return message


def _is_cut_off(path: Path) -> str:
    """How one sees that the end is missing; empty if nothing shows it."""
    match path.suffix.lower():
        case ".blf":
            with path.open("rb") as file:
                _, announced = _BLF_SIZE.unpack(file.read(_BLF_SIZE.size))
            there = path.stat().st_size
            return f"{announced} bytes announced, {there} there" if announced > there else ""
        case ".asc":
            with path.open("rb") as file:
                head = file.read(_HEAD).lower()
            return "it has no End TriggerBlock" if _ASC_BEGIN in head and _ASC_END not in _tail(path).lower() else ""
        case ".log" | ".trc":
            _check_identifiers(path)
            tail = _tail(path)
            return "its last line has no end" if tail and not tail.endswith(b"\n") else ""
    return ""


def _check_identifiers(path: Path) -> None:
    with path.open("rb") as file:
        for number, line in enumerate(file, 1):
            if wide := _WIDE_ID.search(line):
                raise ValueError(f"line {number}: identifier {wide[1].decode()}, must have at most 8 digits")


def _tail(path: Path) -> bytes:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _HEAD))
        return file.read()
