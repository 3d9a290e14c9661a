"""The format ASAM MDF 4: logs and measurements, read and written by asammdf.

Frames are in CAN_DataFrame, CAN_ErrorFrame and CAN_RemoteFrame ("ASAM MDF, Bus Logging", 1.0), as Vector's programs,
CANedge and python-can write them. Our files (4.1) also have channels with units, for programs without our DBC.
"""

import io
import logging
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from datetime import UTC, datetime
from heapq import merge
from importlib import import_module
from math import floor
from pathlib import Path
from typing import Any, Final

import can
import numpy as np

from can_bridge.logs import entries
from can_bridge.logs.entries import BRS, ESI, FD_FRAME, ChannelGroup, Entry, LogEvent, NamedChannel
from can_bridge.wire.frame import FD_LENGTHS
from contract.atomic import replacing
from contract.errors import BusError, install

_DATA_FRAME, _REMOTE_FRAME, _ERROR_FRAME = "CAN_DataFrame", "CAN_RemoteFrame", "CAN_ErrorFrame"
_DATA: Final = {"DLC": "u1", "DataLength": "u1", "DataBytes": "(64,)u1", "EDL": "u1", "BRS": "u1", "ESI": "u1"}
_FIELDS: Final[Mapping[str, Mapping[str, str]]] = {
    _DATA_FRAME: {"ID": "<u4", "IDE": "u1", "Dir": "u1", **_DATA},
    _REMOTE_FRAME: {"ID": "<u4", "IDE": "u1", "Dir": "u1", "DLC": "u1"},
    _ERROR_FRAME: {"ErrorType": "u1"},
}
"""Types of a record's fields, by the group's name and the field's name. The field BusChannel is not included."""
_EXTENDED: Final = 0x80000000
_ERROR_TYPES: Final = {**dict.fromkeys((1, 2, 3, 4), entries.PROTOCOL), 5: entries.NO_ACK}
"""The error class of Linux for each error type of the standard (1 to 5: bit, form, stuff, CRC, acknowledgement)."""


def asammdf_for(path: Path) -> Any:
    """Return the package asammdf. Raises BusError with the file's name if the package is not installed."""
    try:
        package = import_module("asammdf")
    except ImportError as error:
        raise BusError(
            f"{path}: ASAM MDF needs asammdf: {install('mdf')}; or convert from or to BLF on another computer: "
            f"`python -m can.logconvert {path.name} {path.stem}.blf`"
        ) from error
    # asammdf also logs the errors that it raises. Its object for a file that cannot be opened fails in `__del__`.
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    reader: Any = import_module("asammdf.blocks.mdf_v4").MDF4
    reader.__del__ = lambda one: one.close() if {"header", "_file"} <= vars(one).keys() else None
    return package


def read_mdf(path: Path, since_epoch: entries.SinceEpoch) -> Iterator[Entry]:
    """Yield the records' entries by time. Raises BusError without asammdf or frames, ValueError for a damaged file."""
    asammdf = asammdf_for(path)
    failure = asammdf.blocks.utils.MdfException
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            opened = asammdf.MDF(path)
    except (ValueError, OSError, struct.error, failure) as error:
        raise ValueError(f"cut off, damaged, or not ASAM MDF: {error}") from error
    with opened as measurement:
        start = measurement.start_time
        start_s = since_epoch(start) if start.tzinfo is None else start.timestamp()
        groups, others, has_frames = [], list[LogEvent](), False
        for index, group in enumerate(measurement.groups):
            rows = int(group.channel_group.cycles_nr)
            names = [str(channel.name) for channel in group.channels]
            kind = next((one for name in names if (one := name.split(".")[0]) in _FIELDS), None)
            has_frames |= kind is not None
            if kind is not None and rows:
                fields = [name for name in names if name.startswith(f"{kind}.")]
                try:
                    columns = _columns(measurement, index, fields, rows)
                except (ValueError, failure):
                    # Bytes are stored apart from records: after a loss of power, the last record may have no bytes.
                    columns = _columns(measurement, index, fields, rows - 1)
                    others.append(LogEvent("frame without its bytes"))
                groups.append(_frames(kind, columns, start_s))
            elif rows:
                name = next((name.split(".")[0] for name in names if name.lower() not in ("t", "time")), "empty")
                others.append(LogEvent("overload frame" if name == "CAN_OverloadFrame" else f"record of {name}", rows))
        if not has_frames:
            counts = ", ".join(f"{one.name} {one.lines}" for one in others) or "nothing"
            raise BusError(f"{path}: has no CAN frames (groups {_DATA_FRAME} and others); it has {counts}")
        yield from others
        yield from merge(*groups, key=lambda message: message.timestamp)


def _columns(measurement: Any, group: int, names: list[str], rows: int) -> dict[str, Any]:
    """Return the fields of the first `rows` records, by name. Conversions are applied, because the value of a constant
    field may be in its conversion. Conversions of numbers to texts such as "Rx" are not applied."""
    found = {}
    for name in names:
        with redirect_stdout(io.StringIO()):  # asammdf prints a long text before it raises an error
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
        if kind == _ERROR_FRAME:
            yield entries.error_frame(time_s, channel, _ERROR_TYPES.get(of("ErrorType", row), 0))
            continue
        frame_id, is_rx, fd = of("ID", row), not of("Dir", row), FD_FRAME if of("EDL", row) else 0
        is_extended = bool(of("IDE", row)) if "IDE" in columns else bool(frame_id & _EXTENDED)
        ident = (frame_id & ~_EXTENDED, is_extended)
        if "DLC" in columns:
            length = entries.length_of(of("DLC", row), is_fd=bool(fd))
        else:
            length = entries.check_length(of("DataLength", row), is_fd=bool(fd))
        if kind == _REMOTE_FRAME:
            yield entries.frame(time_s, channel, ident, None, dlc=length, is_rx=is_rx)
            continue
        there = of("DataLength", row) if "DataLength" in columns else length
        data = np.asarray(columns["DataBytes"][row], dtype=np.uint8).tobytes()[:there]
        if len(data) != length:
            raise ValueError(f"record {row + 1} of {kind}: {length} bytes are announced, but {len(data)} present")
        fd |= (BRS * (of("BRS", row) == 1) | ESI * (of("ESI", row) == 1)) if fd else 0
        yield entries.frame(time_s, channel, ident, data, fd=fd, is_rx=is_rx)


def write_mdf(path: Path, messages: Sequence[can.Message], groups: Sequence[ChannelGroup]) -> None:
    """Write a measurement, completely or not at all. Times count from the start time in the header. This is the last
    full second before the first message or value, but not before 1970, when virtual time begins. Raises BusError if
    asammdf is missing; StillwakeError if the file cannot be written."""
    asammdf = asammdf_for(path)
    first_s = [*(one.timestamp for one in messages), *(float(one.times_s[0]) for one in groups if len(one.times_s))]
    start_s = max(0, floor(min(first_s)))
    channels = _numbers(messages)
    with asammdf.MDF(version="4.10") as measurement:
        measurement.header.start_time = datetime.fromtimestamp(start_s, UTC)
        for name in _FIELDS:
            records = [one for one in messages if _kind(one) == name]
            source = asammdf.Source(name, "CAN", "", asammdf.Source.SOURCE_BUS, asammdf.Source.BUS_TYPE_CAN)
            times = np.array([one.timestamp for one in records]) - start_s
            comment = ", ".join(f"channel {number}: {channel}" for channel, number in channels.items())
            signal = asammdf.Signal(_records(name, records, channels), times, name=name, source=source)
            measurement.append(signal, acq_name="CAN", acq_source=source, comment=comment)
        for group in groups:
            signals = [_signal(asammdf, group, one, start_s) for one in group.channels]
            measurement.append(signals, acq_name=group.name, comment=group.comment, common_timebase=True)
        with replacing(path) as temporary, temporary.open("w+b") as file:
            measurement.save(file, compression=2)  # transposition and deflate; standard from version 4.1 on


def _kind(message: can.Message) -> str:
    if message.is_error_frame:
        return _ERROR_FRAME
    return _REMOTE_FRAME if message.is_remote_frame else _DATA_FRAME


def _numbers(messages: Sequence[can.Message]) -> dict[str, int]:
    """Number each channel by its name if that is below 256, else by a free number; raise BusError if none is free."""
    names = list(dict.fromkeys(str(one.channel or "") for one in messages))
    found = {name: int(name) for name in names if name.isdecimal() and int(name) < 256}
    if len(names) > 255:
        raise BusError(f"ASAM MDF can number 255 channels, but the frames have {len(names)}")
    free = (number for number in range(1, 256) if number not in found.values())
    return {name: found[name] if name in found else next(free) for name in names}


def _records(name: str, messages: Sequence[can.Message], channels: Mapping[str, int]) -> Any:
    fields = {"BusChannel": "u1", **_FIELDS[name]}
    records = np.zeros(len(messages), dtype=[(f"{name}.{field}", kind) for field, kind in fields.items()])
    for record, one in zip(records, messages, strict=True):
        values: dict[str, Any] = {"BusChannel": channels[str(one.channel or "")]}
        if one.is_error_frame:
            values["ErrorType"] = next((kind for kind, bit in _ERROR_TYPES.items() if one.arbitration_id & bit), 0)
        else:
            values |= {"ID": one.arbitration_id, "IDE": one.is_extended_id, "Dir": not one.is_rx, "DLC": one.dlc}
        if name == _DATA_FRAME:
            data = np.frombuffer(bytes(one.data).ljust(64, b"\0"), dtype=np.uint8)
            flags = {"EDL": one.is_fd, "BRS": one.bitrate_switch, "ESI": one.error_state_indicator}
            values |= {"DLC": FD_LENGTHS.index(len(one.data)), "DataLength": len(one.data), "DataBytes": data, **flags}
        for field, value in values.items():
            record[f"{name}.{field}"] = value
    return records


def _signal(asammdf: Any, group: ChannelGroup, channel: NamedChannel, start_s: float) -> Any:
    words: dict[str, Any] = {f"text_{i}": word.encode() for i, word in enumerate(channel.words.values())}
    words |= {f"val_{i}": value for i, value in enumerate(channel.words)}
    return asammdf.Signal(
        channel.values.astype(np.uint8) if channel.words else channel.values,
        group.times_s - start_s,
        name=f"{group.name}.{channel.name}",
        unit=channel.unit,
        conversion=words or None,
    )
