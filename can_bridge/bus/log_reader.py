"""Recorded CAN traffic, whatever wrote it: candump (.log), Vector ASC and BLF, PEAK TRC, and MF4 with asammdf."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import can

from contract.errors import BusError

SUFFIXES: Final = (".log", ".asc", ".blf", ".trc", ".mf4")


def read_messages(path: Path) -> Iterator[can.Message]:
    """The messages of a log in the order of the file, as python-can reads them; timestamps in s.

    Raises:
        BusError: naming the file, if it is not there, of another kind, or damaged, after what could be read.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise BusError(f"{path}: a log must end in {', '.join(SUFFIXES)}")
    try:
        with can.LogReader(path) as reader:
            yield from reader
    except Exception as error:
        raise BusError(f"{path}: cannot be read as a CAN log ({error or type(error).__name__})") from error
