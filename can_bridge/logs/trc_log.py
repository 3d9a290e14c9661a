"""The trace files of PEAK, versions 1.0 to 2.1: "PEAK CAN TRC File Format", 2020. Times are in ms since the start.

The header of versions 2.0 and 2.1 names the columns; versions 1.0 to 1.3 have fixed columns.
"""

from collections.abc import Iterator
from datetime import datetime, timedelta
from typing import Final

from can_bridge.logs import entries
from can_bridge.logs.entries import BRS, ESI, FD_FRAME, Entry, LogEvent
from can_bridge.wire.frame import FD_LENGTHS
from contract.printable import quoted

_COLUMNS: Final = {"1.0": "NOIL", "1.1": "NOTIL", "1.2": "NOBTIL", "1.3": "NOBTIRL"}
"""Columns before the data by version: number N, time O, bus B, type or direction T, id I, reserved R, length code L."""
_STATUS: Final = "hardware status"
_EVENTS: Final = {
    "ST": _STATUS,
    "WARNG": _STATUS,
    "EC": "error counters",
    "EV": "user-defined event",
    "OV": "overload frame",
}
_FD: Final = {"FD": FD_FRAME, "FB": FD_FRAME | BRS, "FE": FD_FRAME | ESI, "BI": FD_FRAME | BRS | ESI}


def read_trc(lines: entries.Lines, since_epoch: entries.SinceEpoch) -> Iterator[Entry]:
    """Yield the entries of the lines. Raises ValueError for a line that is not in the file's format."""
    columns, start_s = list(_COLUMNS["1.0"]), 0.0
    for line in lines:
        text = line.strip()
        if not text.startswith(";"):
            yield _entry(text, columns, start_s, is_whole=line.endswith("\n"))
            continue
        name, _, value = text[1:].strip().partition("=")
        match name.upper():
            case "$FILEVERSION":
                columns = list(_COLUMNS.get(value, ""))
                if value not in _COLUMNS and value not in ("2.0", "2.1"):
                    raise ValueError(f"version {quoted(value)} must be {', '.join(_COLUMNS)}, 2.0 or 2.1")
            case "$STARTTIME":
                start_s = since_epoch(datetime(1899, 12, 30) + timedelta(days=float(value.replace(",", "."))))
            case "$COLUMNS":
                columns = value.split(",")
                if not {"O", "I"} <= set(columns) or not {"l", "L"} & set(columns):
                    raise ValueError(f"columns {quoted(value, 60)} must have O (time), I, and l or L (length)")
        yield LogEvent(entries.HEADER_LINE if name.startswith("$") else entries.COMMENT)


def _entry(text: str, columns: list[str], start_s: float, *, is_whole: bool) -> Entry:
    if not columns:
        raise ValueError("the frame is before the line ;$COLUMNS, which this version must have")
    head = [name for name in columns if name != "D"]
    words = text.split()
    kind = words[columns.index("T")].upper() if "T" in columns and len(words) > columns.index("T") else ""
    if kind in _EVENTS:
        return LogEvent(_EVENTS[kind])
    if len(words) < 3:
        raise ValueError(f"{quoted(text, 60)} ends before the frame's length")
    time_s = start_s + float(words[columns.index("O")]) / 1e3
    channel = words[columns.index("B")] if "B" in columns else ""
    if kind in ("ER", "ERROR"):
        return entries.error_frame(time_s, channel, entries.PROTOCOL)
    if len(words) < len(head):
        raise ValueError(f"{quoted(text, 60)} ends before the frame's length")
    values = dict(zip(head, words, strict=False))
    rest = words[len(head) :]
    frame_id = values["I"]
    if frame_id.upper() == "FFFFFFFF":  # a warning
        return LogEvent(_STATUS)
    if rest[:1] == ["ERROR"]:
        return entries.error_frame(time_s, channel, entries.PROTOCOL)
    is_fd = kind in _FD
    if "l" in values:
        length = entries.check_length(int(values["l"]), is_fd=is_fd)
    else:
        code = int(values["L"])
        # Some writers put the length in bytes there. The line's number of bytes shows this, unless it may be cut.
        is_length = is_fd and code in FD_LENGTHS and (code > 15 or (is_whole and len(rest) == code))
        length = code if is_length else entries.length_of(code, is_fd=is_fd)
    direction = values.get("d", kind).upper()
    ident, is_rx = (int(frame_id, 16), len(frame_id) > 4), direction != "TX"
    if kind == "RR" or rest[:1] == ["RTR"]:
        return entries.frame(time_s, channel, ident, None, dlc=length, is_rx=is_rx)
    if kind not in ("", "RX", "TX", "DT", *_FD) or direction not in ("", "RX", "TX", "DT"):
        raise ValueError(f"{quoted(kind)} is not a frame type of this format")
    data = entries.bytes_of(rest, length)
    if len(rest) > length:
        raise ValueError(f"{length} bytes are announced, but {len(rest)} are present")
    return entries.frame(time_s, channel, ident, data, fd=_FD.get(kind, 0), is_rx=is_rx)
