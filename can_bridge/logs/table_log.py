"""The tables of python-can's logger: CSV and an SQLite database. A table has no channels and does not state whether a
frame is CAN FD; only our CAN FD messages and messages longer than 8 bytes are read as CAN FD."""

import base64
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Final
from urllib.parse import quote

from can_bridge.logs import entries
from can_bridge.logs.entries import BRS, FD_FRAME, FD_IDS, HEADER_LINE, Entry, Lines, LogEvent, error_frame, frame
from contract.printable import quoted

TABLE_COLUMNS: Final = "timestamp,arbitration_id,extended,remote,error,dlc,data"
"""First line of a CSV file of python-can's logger."""


def read_csv(lines: Lines) -> Iterator[Entry]:
    """Yield the entries of the lines. Raises ValueError for a line that is not a row of the table."""
    for line in lines:
        text = line.strip()
        if lines.number == 1:
            if text != TABLE_COLUMNS:
                raise ValueError(f"{quoted(text, 60)} must be {TABLE_COLUMNS}, as python-can's logger writes it")
            yield LogEvent(HEADER_LINE)
            continue
        values = text.split(",")
        if len(values) != TABLE_COLUMNS.count(",") + 1:
            raise ValueError(f"it has {len(values)} values: must have {TABLE_COLUMNS.count(',') + 1}")
        flags, dlc = [bool(int(value)) for value in values[2:5]], int(values[5])
        yield _entry(float(values[0]), int(values[1], 16), flags, dlc, base64.b64decode(values[6], validate=True))


def read_db(path: Path) -> Iterator[Entry]:
    """Yield the entries of the rows. Raises ValueError with an invalid row's number, sqlite3.Error for another file."""
    with closing(sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True)) as database:
        columns = TABLE_COLUMNS.replace("timestamp", "ts")
        for number, row in enumerate(database.execute(f"SELECT {columns} FROM messages ORDER BY rowid"), 1):
            try:
                time_s, frame_id, *flags, dlc, data = row
                yield _entry(float(time_s), frame_id, [bool(one) for one in flags], dlc, bytes(data or b""))
            except (ValueError, TypeError) as error:
                raise ValueError(f"row {number}: {error}") from None


def _entry(time_s: float, frame_id: int, flags: list[bool], dlc: int, data: bytes) -> Entry:
    is_extended, is_remote, is_error = flags
    if is_error:
        return error_frame(time_s, "", frame_id)
    if is_remote:
        return frame(time_s, "", (frame_id, is_extended), None, dlc=dlc)
    if dlc != len(data):
        raise ValueError(f"{dlc} bytes are announced, but {len(data)} are present")
    is_fd = entries.check_length(dlc, is_fd=True) > 8 or (frame_id in FD_IDS and not is_extended)
    return frame(time_s, "", (frame_id, is_extended), data, fd=FD_FRAME | BRS if is_fd else 0)
