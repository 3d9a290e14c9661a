"""The MCAP files: a topic of frames, and a topic for each group of channels, in Protobuf. A file contains its schemas,
so that Foxglove, Rerun and PlotJuggler can read it. The log reader counts messages that are not frames as events."""

import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from heapq import merge
from pathlib import Path
from typing import Any, Final

import can
import numpy as np

from can_bridge.logs.entries import BRS, ESI, FD_FRAME, ChannelGroup, Entry, LogEvent, check_length, error_frame, frame
from can_bridge.wire.message_specs import SPECS
from contract.atomic import replacing
from contract.errors import BusError, install

_PACKAGE: Final = "stillwake"
_NAMES: Final = {spec.frame_id: spec.name for spec in SPECS}
_FRAME: Final = {
    **{"message": "STRING", "id": "UINT32", "data": "BYTES", "channel": "STRING"},
    **dict.fromkeys(("extended", "fd", "bitrate_switch", "received", "remote", "error"), "BOOL"),
    **{"error_state_indicator": "BOOL", "dlc": "UINT32"},
}
"""Types of the fields of a frame, by name. The id of an error frame has the error classes of linux/can/error.h."""

WAKE_TOPIC: Final = "/wake"
EVENTS_TOPIC: Final = "/events"
_LAYOUT: Final = Path(__file__).with_name("foxglove_layout.json")
Dated = tuple[str, int, Any]
"""A message of a topic: topic, time in ns, and Protobuf message."""


def layout_of(path: Path) -> Path:
    """Return the path of the layout for Foxglove that is written beside an MCAP file."""
    return path.with_suffix(".layout.json")


def write_mcap(
    path: Path,
    messages: Sequence[can.Message],
    groups: Sequence[ChannelGroup],
    *,
    events: Iterable[Dated] = (),
    facts: Mapping[str, str],
) -> None:
    """Write an MCAP file whose messages are in the order of time, and a layout for Foxglove beside it. Each file is
    written completely or not at all. Raises BusError for a time before 0, which the format cannot represent."""
    from mcap_protobuf.writer import Writer

    first_s = min([*(one.timestamp for one in messages), *(one.times_s[0] for one in groups if len(one.times_s)), 0.0])
    if first_s < 0.0:
        raise BusError(f"{path}: MCAP has no times before 0, but the first time is {first_s:g} s")
    dated = merge(_frames(messages), *map(_values, groups), events, key=lambda one: one[1])
    with replacing(path) as temporary, temporary.open("wb") as file, Writer(file) as writer:
        writer.add_metadata("run", dict(facts))
        for sequence, (topic, time_ns, message) in enumerate(dated):
            writer.write_message(topic, message, log_time=time_ns, publish_time=time_ns, sequence=sequence)
    with replacing(layout_of(path)) as temporary:
        shutil.copyfile(_LAYOUT, temporary)


def _frames(messages: Sequence[can.Message]) -> Iterator[Dated]:
    kind = _message_class("Frame", _FRAME)
    for one in messages:
        frame = kind(
            message="" if one.is_extended_id or one.is_error_frame else _NAMES.get(one.arbitration_id, ""),
            id=one.arbitration_id,
            data=bytes(one.data),
            channel=str(one.channel or ""),
            extended=one.is_extended_id,
            fd=one.is_fd,
            bitrate_switch=one.bitrate_switch,
            received=one.is_rx,
            remote=one.is_remote_frame,
            error=one.is_error_frame,
            error_state_indicator=one.error_state_indicator,
            dlc=one.dlc,
        )
        yield "/frames", round(one.timestamp * 1e9), frame


def _values(group: ChannelGroup) -> Iterator[Dated]:
    kind = _message_class(group.name, {one.identifier: one.words or "DOUBLE" for one in group.channels})
    columns = {one.identifier: one.values.astype(int) if one.words else one.values for one in group.channels}
    for row, time_ns in enumerate(np.rint(group.times_s * 1e9).astype(int).tolist()):
        yield f"/{group.name}", time_ns, kind(**{name: values[row].item() for name, values in columns.items()})


def _message_class(name: str, fields: Mapping[str, str | Mapping[int, str]]) -> Any:
    """Return the class of a Protobuf message. `fields` has each field's type by name; for an enumeration, its words."""
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
    from google.protobuf.descriptor_pool import DescriptorPool
    from google.protobuf.message_factory import GetMessageClass

    file = FileDescriptorProto(name=f"{_PACKAGE}/{name}.proto", package=_PACKAGE, syntax="proto3")
    message = file.message_type.add(name=name)
    for number, (field, kind) in enumerate(fields.items(), 1):
        added = message.field.add(name=field, number=number, label=FieldDescriptorProto.LABEL_OPTIONAL)
        if isinstance(kind, str):
            added.type = getattr(FieldDescriptorProto, f"TYPE_{kind}")
            continue
        added.type, added.type_name = FieldDescriptorProto.TYPE_ENUM, f".{_PACKAGE}.{name}.{field}Word"
        words = message.enum_type.add(name=f"{field}Word")
        for value, word in kind.items():
            words.value.add(name=word, number=value)
    pool = DescriptorPool()
    pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(f"{_PACKAGE}.{name}"))


def read_mcap(path: Path) -> Iterator[Entry]:
    """Yield an entry for each message by time. Raises BusError without package or frames, McapError for damage."""
    try:
        from mcap.reader import make_reader
        from mcap_protobuf.decoder import DecoderFactory
    except ImportError as error:
        raise BusError(f"{path}: MCAP needs mcap-protobuf-support: {install('mcap')}") from error
    decoders, has_frames, count = DecoderFactory(), False, 0
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            count += 1
            name = schema.name if schema else channel.topic
            ours = schema if name == f"{_PACKAGE}.Frame" else None
            if decode := decoders.decoder_for(channel.message_encoding, ours):
                has_frames = True
                yield _entry(message.log_time / 1e9, decode(message.data))
            else:
                yield LogEvent(f"record of {name.rpartition('.')[2]}")
    if not has_frames:
        raise BusError(f"{path}: has no CAN frames, only {count} other messages")


def _entry(time_s: float, one: Any) -> Entry:
    if one.error:
        return error_frame(time_s, one.channel, one.id)
    fd = FD_FRAME * one.fd | BRS * one.bitrate_switch | ESI * one.error_state_indicator
    data = None if one.remote else one.data
    check_length(len(data or b""), is_fd=one.fd)
    return frame(time_s, one.channel, (one.id, one.extended), data, fd=fd, is_rx=one.received, dlc=one.dlc)
