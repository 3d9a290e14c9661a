"""The BLF format of Vector: objects, mostly in compressed containers. Vector publishes no description of the format;
the reader follows the files that Vector's binlog and python-can write.
"""

import struct
import zlib
from collections.abc import Iterator
from datetime import datetime
from typing import Final

import can

from can_bridge.logs import entries
from can_bridge.logs.entries import Entry, LogEvent

_FILE: Final = struct.Struct("<4s L 8x Q Q 8x 8H")
"""Header of the file: signature, header length, file size, unpacked size, start as a Windows SYSTEMTIME."""
_BASE: Final = struct.Struct("<4s H H L L")
"""Beginning of an object: signature, header length, header version, object size, type."""
_STAMP: Final = struct.Struct("<L 4x Q")
"""Time of an object: flags of the time, and the time since the start."""
_CONTAINER: Final = struct.Struct("<H 6x L 4x")
_CLASSIC: Final = struct.Struct("<H B B L 8s")
"""Classic frame: channel, flags, length code, identifier, data."""
_FD: Final = struct.Struct("<H B B L L B B B 5x 64s")
"""CAN FD frame: channel, flags, length code, identifier, bus time, bit count, CAN FD flags, stored byte count, data."""
_FD_64: Final = struct.Struct("<B B B x L 4x L 18x B B 4x")
"""CAN FD frame in the newer form: channel, length code, stored bytes, identifier, flags, direction, end of the data."""

_MESSAGES: Final = (1, 86)
_CONTAINER_TYPE, _FD_TYPE, _FD_64_TYPE, _FD_ERROR_TYPE = 10, 100, 101, 104
_FRAMES: Final = (*_MESSAGES, _FD_TYPE, _FD_64_TYPE, 2, 73, _FD_ERROR_TYPE)
_NAMES: Final = {
    3: "overload frame",
    4: "statistics",
    5: "trigger",
    **dict.fromkeys((6, 7, 8, 9), "environment variable"),
    **dict.fromkeys((31, 74), "driver error"),
    44: "driver synchronised",
    46: "GPS",
    51: "clock time",
    65: "text",
    72: "system variable",
    91: "driver overrun",
    92: entries.COMMENT,
    96: "marker",
    115: "restore point",
    125: "data lost, begin",
    126: "data lost, end",
}
_EXTENDED: Final = 0x80000000
_REMOTE, _DIRECTION = 0x80, 0xF
_TX, _TX_REQUEST = 1, 2


def read_blf(file: entries.Binary, since_epoch: entries.SinceEpoch) -> Iterator[Entry]:
    """Yield an entry for each object but containers. Raises ValueError for another format, CutOffError if cut off."""
    head = file.read(_FILE.size)
    if head[:4] != b"LOGG" or len(head) < _FILE.size:
        raise ValueError("its header is not the header of a BLF file")
    _, header_size, announced, _, *start = _FILE.unpack(head)
    there = len(head) + len(file.read(header_size - _FILE.size))
    year, month, _, day, hour, minute, second, ms = start
    begin = datetime(year, month, day, hour, minute, second, ms * 1000) if year else None
    start_ns = 0 if begin is None else round(since_epoch(begin) * 1e3) * 1_000_000
    outside, inside = _Stream(), _Stream()
    while block := file.read(1 << 20):
        there += len(block)
        for kind, one, header in outside.objects(block):
            found = inside.objects(_unpacked(one)) if kind == _CONTAINER_TYPE else [(kind, one, header)]
            for found_kind, found_object, found_header in found:
                yield _entry(found_kind, found_object, found_header, start_ns)
    if announced > there:
        raise entries.CutOffError(f"its header announces {announced} bytes, but {there} are present")
    if any(b"LOBJ" in stream.rest for stream in (outside, inside)):
        raise entries.CutOffError("its last object is incomplete")


def _entry(kind: int, one: bytes, header: int, start_ns: int) -> Entry:
    if kind not in _FRAMES:
        return LogEvent(_NAMES.get(kind, f"object of type {kind}"))
    flags, stamp = _STAMP.unpack_from(one, _BASE.size)
    time_s = (start_ns + stamp * (10_000 if flags == 1 else 1)) / 1e9  # in units of 10 us or 1 ns
    if kind in _MESSAGES:
        channel, flags, code, frame_id, data = _CLASSIC.unpack_from(one, header)
        return _frame(time_s, channel, frame_id, code, data, flags)
    if kind == _FD_TYPE:
        channel, flags, code, frame_id, _, _, fd, valid, data = _FD.unpack_from(one, header)
        return _frame(time_s, channel, frame_id, code, data[:valid], flags, fd & 7)
    if kind == _FD_64_TYPE:
        channel, code, valid, frame_id, flags, direction, behind = _FD_64.unpack_from(one, header)
        # If fewer bytes are stored than announced, the missing bytes count as zero, as in Vector's own programs.
        data = one[header + _FD_64.size : behind or None][:valid].ljust(valid, b"\0")
        return _frame(time_s, channel, frame_id, code, data, direction | (flags & 0x10) << 3, flags >> 12 & 7)
    (channel,) = struct.unpack_from("<H", one, header)
    return entries.error_frame(time_s, str(channel & (0xFF if kind == _FD_ERROR_TYPE else 0xFFFF)))


class _Stream:
    """A sequence of objects; the last object of a block may continue in the next block."""

    def __init__(self) -> None:
        self.rest = b""

    def objects(self, block: bytes) -> Iterator[tuple[int, bytes, int]]:
        """Yield each object's type, bytes and header length. Raises ValueError if an object is missing or too short."""
        data, at = self.rest + block, 0
        while True:
            # Up to three bytes of padding come between objects, depending on their type.
            begin = data.find(b"LOBJ", at, at + 8)
            if begin < 0:
                if len(data) - at >= 8:
                    raise ValueError(f"no object begins after {at} bytes of a block, where an object must begin")
                break
            if len(data) - begin < _BASE.size:
                break
            _, header, _, size, kind = _BASE.unpack_from(data, begin)
            if size < _BASE.size or header > size:
                raise ValueError(f"an object of {size} bytes is shorter than its header")
            if len(data) - begin < size:
                break
            yield kind, data[begin : begin + size], header
            at = begin + size
        self.rest = data[at:]


def _unpacked(container: bytes) -> bytes:
    method, _ = _CONTAINER.unpack_from(container, _BASE.size)
    packed = container[_BASE.size + _CONTAINER.size :]
    if method not in (0, 2):
        raise ValueError(f"a container has compression {method}: must be 0 (none) or 2 (zlib)")
    return zlib.decompressobj().decompress(packed) if method == 2 else packed


def _frame(
    time_s: float, channel: int, frame_id: int, code: int, data: bytes, flags: int, fd: int = 0
) -> can.Message | LogEvent:
    """Return a frame, or a transmit request's event. `flags`: direction, remote bit; `fd`: `FD_FRAME`, `BRS`, `ESI`."""
    if flags & _DIRECTION == _TX_REQUEST:
        return LogEvent(entries.REQUEST)
    length, is_rx = entries.length_of(code, is_fd=bool(fd)), flags & _DIRECTION != _TX
    ident = (frame_id & ~_EXTENDED, bool(frame_id & _EXTENDED))
    if flags & _REMOTE and not fd:
        return entries.frame(time_s, str(channel), ident, None, dlc=length, is_rx=is_rx)
    if len(data) < length:
        raise ValueError(f"{length} bytes are announced, but {len(data)} are present")
    return entries.frame(time_s, str(channel), ident, data[:length], fd=fd, is_rx=is_rx)
