"""Logs in ASAM MDF 4, read by asammdf: the groups CAN_DataFrame, CAN_ErrorFrame and CAN_RemoteFrame ("ASAM MDF, Bus
Logging", 1.0), as Vector's programs, CANedge loggers and python-can write them."""

import io
import logging
import struct
from collections.abc import Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from heapq import merge
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import can
import numpy as np

from can_bridge.logs.entries import (
    BRS,
    ESI,
    FD_FRAME,
    NO_ACK,
    PROTOCOL,
    Entry,
    LogEvent,
    SinceEpoch,
    error_frame,
    frame,
    length_of,
)
from contract.errors import BusError, install

_DATA, _ERROR, _REMOTE = "CAN_DataFrame", "CAN_ErrorFrame", "CAN_RemoteFrame"
_NAMES: Final = {"CAN_OverloadFrame": "overload frame"}
_EXTENDED: Final = 0x80000000
ERROR_TYPES: Final = {**dict.fromkeys((1, 2, 3, 4), PROTOCOL), 5: NO_ACK}
"""Linux's error classes, by the standard's error types (bit, form, stuff, CRC, acknowledgement)."""


def asammdf_for(path: Path) -> Any:
    """Return the package asammdf. Raises BusError, which states the file's name, if the package is not installed."""
    try:
        package = import_module("asammdf")
    except ImportError as error:
        raise BusError(
            f"{path}: ASAM MDF needs asammdf: {install('mdf')}; or convert elsewhere, from or to BLF: "
            f"`python -m can.logconvert {path.name} {path.stem}.blf`"
        ) from error
    # asammdf also logs each error that it raises. Its object for a file that it could not open causes an error when
    # Python deletes the object.
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    reader: Any = import_module("asammdf.blocks.mdf_v4").MDF4
    reader.__del__ = lambda one: one.close() if {"header", "_file"} <= vars(one).keys() else None
    return package


class Records:
    """The records of a measurement.

    Attributes:
        count: number of records read so far, of all groups.
    """

    def __init__(self, path: Path) -> None:
        self.count = 0
        self._path = path

    def read(self, since_epoch: SinceEpoch) -> Iterator[Entry]:
        """Yield the entries of the records in the order of time. Raises BusError if asammdf is missing or there are no
        CAN frames."""
        with self._opened() as measurement:
            start = measurement.start_time
            start_s = since_epoch(start) if start.tzinfo is None else start.timestamp()
            groups, others, has_frames = [], list[LogEvent](), False
            for index, group in enumerate(measurement.groups):
                rows = int(group.channel_group.cycles_nr)
                self.count += rows
                names = [str(channel.name) for channel in group.channels]
                kind = next((one for name in names if (one := name.split(".")[0]) in (_DATA, _ERROR, _REMOTE)), None)
                has_frames |= kind is not None
                if kind is not None and rows:
                    fields = [name for name in names if name.startswith(f"{kind}.")]
                    try:
                        columns = _columns(measurement, index, fields, rows)
                    except (ValueError, self._failure):
                        # A frame's bytes are stored outside its record. If a logger loses power, the bytes of its last
                        # frame may be missing.
                        columns = _columns(measurement, index, fields, rows - 1)
                        others.append(LogEvent("frame without its bytes"))
                    groups.append(_frames(kind, columns, start_s))
                elif rows:
                    name = next((name.split(".")[0] for name in names if name.lower() not in ("t", "time")), "empty")
                    others.append(LogEvent(_NAMES.get(name, f"record of {name}"), rows))
            if not has_frames:
                counts = ", ".join(f"{one.name} {one.lines}" for one in others) or "nothing"
                raise BusError(f"{self._path}: has no CAN frames (groups {_DATA} and others); it has {counts}")
            yield from others
            yield from merge(*groups, key=lambda message: message.timestamp)

    def _opened(self) -> Any:
        asammdf = asammdf_for(self._path)
        self._failure = asammdf.blocks.utils.MdfException
        try:
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                return asammdf.MDF(self._path)
        except (ValueError, OSError, struct.error, self._failure) as error:
            raise ValueError(f"cut off, damaged, or no ASAM MDF: {error}") from error


def _columns(measurement: Any, group: int, names: list[str], rows: int) -> dict[str, Any]:
    """Return the fields of the first `rows` records, by name. Constants may be stored in conversions, so conversions
    are applied, except those that replace numbers by texts such as "Rx"."""
    found = {}
    for name in names:
        with redirect_stdout(io.StringIO()):  # asammdf prints a page before it raises
            signal = measurement.get(name, group=group, raw=True, record_count=rows)
        found[name.rpartition(".")[2]] = signal.physical(ignore_value2text_conversions=True)
    return found


def _frames(kind: str, fields: Mapping[str, Any], start_s: float) -> Iterator[can.Message]:
    times = start_s + next(iter(fields.values())).timestamps
    columns = {name: np.asarray(signal.samples) for name, signal in fields.items()}

    def of(name: str, row: int) -> int:
        return int(columns[name][row]) if name in columns else 0

    for row, time_s in enumerate(times.tolist()):
        channel = str(of("BusChannel", row)) if "BusChannel" in columns else ""
        if kind == _ERROR:
            yield error_frame(time_s, channel, ERROR_TYPES.get(of("ErrorType", row), 0))
            continue
        frame_id, is_rx, fd = of("ID", row), not of("Dir", row), FD_FRAME if of("EDL", row) else 0
        is_extended = bool(of("IDE", row)) if "IDE" in columns else bool(frame_id & _EXTENDED)
        ident = (frame_id & ~_EXTENDED, is_extended)
        length = length_of(of("DLC", row), is_fd=bool(fd)) if "DLC" in columns else of("DataLength", row)
        if kind == _REMOTE:
            yield frame(time_s, channel, ident, None, dlc=length, is_rx=is_rx)
            continue
        there = of("DataLength", row) if "DataLength" in columns else length
        data = np.asarray(columns["DataBytes"][row], dtype=np.uint8).tobytes()[:there]
        if len(data) != length:
            raise ValueError(f"record {row + 1} of {kind}: {length} bytes announced, {len(data)} present")
        fd |= (BRS * (of("BRS", row) == 1) | ESI * (of("ESI", row) == 1)) if fd else 0
        yield frame(time_s, channel, ident, data, fd=fd, is_rx=is_rx)
