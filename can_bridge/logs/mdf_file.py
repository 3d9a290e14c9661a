"""Measurements in ASAM MDF 4.1: frames as in "ASAM MDF, Bus Logging", and named channels with units, for programs
without our DBC."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from math import floor
from pathlib import Path
from typing import Any, Final

import can
import numpy as np

from can_bridge.logs.channels import ChannelGroup, NamedChannel
from can_bridge.logs.mdf_log import ERROR_TYPES, asammdf_for
from contract.atomic import replacing

_DATA: Final = {"DLC": "u1", "DataLength": "u1", "DataBytes": "(64,)u1", "EDL": "u1", "BRS": "u1", "ESI": "u1"}
_FIELDS: Final[Mapping[str, Mapping[str, str]]] = {
    "CAN_DataFrame": {"ID": "<u4", "IDE": "u1", "Dir": "u1", **_DATA},
    "CAN_RemoteFrame": {"ID": "<u4", "IDE": "u1", "Dir": "u1", "DLC": "u1"},
    "CAN_ErrorFrame": {"ErrorType": "u1"},
}
"""Type of each field of a record, except the field BusChannel, by the name of the group and the name of the field."""
_CODES: Final = {length: code for code, length in enumerate((*range(9), 12, 16, 20, 24, 32, 48, 64))}
_SMALLEST: Final = 2
"""asammdf's number for compression by transposition and deflate, which the standard allows from version 4.1 on."""


def write_mdf(path: Path, messages: Sequence[can.Message], groups: Sequence[ChannelGroup]) -> None:
    """Write a measurement, completely or not at all. Raises BusError if asammdf is missing; StillwakeError if the file
    cannot be written.

    Times count from the start that the header states: the last full second before the first message or value. The start
    is not before 1970, which is the start of a run in virtual time.
    """
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
            samples = _records(name, records, channels)
            comment = ", ".join(f"channel {number}: {channel}" for channel, number in channels.items())
            signal = asammdf.Signal(samples, times, name=name, source=source)
            measurement.append(signal, acq_name="CAN", acq_source=source, comment=comment)
        for group in groups:
            measurement.append(
                [_signal(asammdf, group, one, start_s) for one in group.channels],
                acq_name=group.name,
                comment=group.comment,
                common_timebase=True,
            )
        with replacing(path) as temporary, temporary.open("w+b") as file:
            measurement.save(file, compression=_SMALLEST)


def _kind(message: can.Message) -> str:
    if message.is_error_frame:
        return "CAN_ErrorFrame"
    return "CAN_RemoteFrame" if message.is_remote_frame else "CAN_DataFrame"


def _numbers(messages: Sequence[can.Message]) -> dict[str, int]:
    """Return a number for each channel: the channel's name if it is a number below 256, or else the first free number
    from 1 on."""
    names = list(dict.fromkeys(str(one.channel or "") for one in messages))
    found = {name: int(name) for name in names if name.isdecimal() and int(name) < 256}
    free = (number for number in range(1, 256) if number not in found.values())
    return {name: found[name] if name in found else next(free) for name in names}


def _records(name: str, messages: Sequence[can.Message], channels: Mapping[str, int]) -> Any:
    fields = {"BusChannel": "u1", **_FIELDS[name]}
    records = np.zeros(len(messages), dtype=[(f"{name}.{field}", kind) for field, kind in fields.items()])
    for record, one in zip(records, messages, strict=True):
        values: dict[str, Any] = {"BusChannel": channels[str(one.channel or "")]}
        if one.is_error_frame:
            values["ErrorType"] = next((kind for kind, bit in ERROR_TYPES.items() if one.arbitration_id & bit), 0)
        else:
            values |= {"ID": one.arbitration_id, "IDE": one.is_extended_id, "Dir": not one.is_rx, "DLC": one.dlc}
        if name == "CAN_DataFrame":
            data = np.frombuffer(bytes(one.data).ljust(64, b"\0"), dtype=np.uint8)
            flags = {"EDL": one.is_fd, "BRS": one.bitrate_switch, "ESI": one.error_state_indicator}
            values |= {"DLC": _CODES[len(one.data)], "DataLength": len(one.data), "DataBytes": data, **flags}
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
