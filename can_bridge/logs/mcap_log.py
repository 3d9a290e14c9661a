"""The frames of an MCAP measurement, as `mcap_file` writes them; messages of other topics are counted."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from can_bridge.logs.entries import BRS, ESI, FD_FRAME, Entry, LogEvent, error_frame, frame
from contract.errors import BusError, install

_FRAME: Final = "stillwake.Frame"
"""Name of the schema of frames."""


class McapMessages:
    """The messages of a measurement.

    Attributes:
        count: number of messages so far, of all topics.
    """

    def __init__(self, path: Path) -> None:
        self.count = 0
        self._path = path

    def read(self) -> Iterator[Entry]:
        """Yield the entries of the messages in the order of time. Raises BusError if a package is missing or there is
        no frame; McapError for a damaged file."""
        try:
            from mcap.reader import make_reader
            from mcap_protobuf.decoder import DecoderFactory
        except ImportError as error:
            raise BusError(f"{self._path}: MCAP needs mcap-protobuf-support: {install('mcap')}") from error
        decoders, has_frames = DecoderFactory(), False
        with self._path.open("rb") as file:
            for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
                self.count += 1
                name = schema.name if schema else channel.topic
                decode = decoders.decoder_for(channel.message_encoding, schema) if name == _FRAME else None
                if decode is None:
                    yield LogEvent(f"record of {name.rpartition('.')[2]}")
                    continue
                has_frames = True
                yield _entry(message.log_time / 1e9, decode(message.data))
        if not has_frames:
            raise BusError(f"{self._path}: has no frames of CAN (messages {_FRAME}), among {self.count} messages")


def _entry(time_s: float, one: Any) -> Entry:
    if one.error:
        return error_frame(time_s, one.channel, one.id)
    fd = FD_FRAME * one.fd | BRS * one.bitrate_switch | ESI * one.error_state_indicator
    data = None if one.remote else one.data
    return frame(time_s, one.channel, (one.id, one.extended), data, fd=fd, is_rx=one.received, dlc=one.dlc)
