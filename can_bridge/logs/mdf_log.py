"""Bus logging in ASAM MDF 4, read by asammdf: groups CAN_DataFrame, CAN_ErrorFrame and CAN_RemoteFrame ("ASAM MDF, Bus
Logging", 1.0), as written by Vector's programs, CANedge loggers and python-can."""

from collections.abc import Iterator, Mapping
from heapq import merge
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
_ERROR_TYPES: Final = {**dict.fromkeys((1, 2, 3, 4), PROTOCOL), 5: NO_ACK}
"""Linux's error classes, by the standard's error types (bit, form, stuff, CRC, acknowledgement)."""


class Records:
    """The records of a measurement.

    Attributes:
        count: number of records so far, of all groups.
    """

    def __init__(self, path: Path) -> None:
        self.count = 0
        self._path = path

    def read(self, since_epoch: SinceEpoch) -> Iterator[Entry]:
        """Yield the entries of the records in the order of time. Raises BusError if asammdf is missing."""
        try:
            from asammdf import MDF
        except ImportError as error:
            raise BusError(
                f"{self._path}: ASAM MDF is read by asammdf: {install('mdf')}; or convert it elsewhere: "
                f"`python -m can.logconvert {self._path.name} {self._path.stem}.blf`"
            ) from error
        with MDF(self._path) as opened:
            measurement: Any = opened
            start = measurement.start_time
            start_s = since_epoch(start) if start.tzinfo is None else start.timestamp()
            groups = []
            for index, group in enumerate(measurement.groups):
                rows = int(group.channel_group.cycles_nr)
                self.count += rows
                names = [str(channel.name) for channel in group.channels]
                kind = next((one for name in names if (one := name.split(".")[0]) in (_DATA, _ERROR, _REMOTE)), None)
                if kind is not None and rows:
                    fields = {
                        name.rpartition(".")[2]: measurement.get(name, group=index, raw=True)
                        for name in names
                        if name.startswith(f"{kind}.")
                    }
                    groups.append(_frames(kind, fields, start_s))
                elif rows:
                    name = next((name.split(".")[0] for name in names if name.lower() not in ("t", "time")), "empty")
                    yield LogEvent(_NAMES.get(name, f"record of {name}"), rows)
            yield from merge(*groups, key=lambda message: message.timestamp)


def _frames(kind: str, fields: Mapping[str, Any], start_s: float) -> Iterator[can.Message]:
    times = start_s + next(iter(fields.values())).timestamps
    columns = {name: np.asarray(signal.samples) for name, signal in fields.items()}

    def of(name: str, row: int) -> int:
        return int(columns[name][row]) if name in columns else 0

    for row, time_s in enumerate(times.tolist()):
        channel = str(of("BusChannel", row)) if "BusChannel" in columns else ""
        if kind == _ERROR:
            yield error_frame(time_s, channel, _ERROR_TYPES.get(of("ErrorType", row), 0))
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
            raise ValueError(f"record {row + 1} of {kind}: {length} bytes announced, {len(data)} there")
        fd |= (BRS * (of("BRS", row) == 1) | ESI * (of("ESI", row) == 1)) if fd else 0
        yield frame(time_s, channel, ident, data, fd=fd, is_rx=is_rx)
