"""Captured frames in a file that python-can, candump, CANoe, PCAN-View or a plain editor can read.

The ending chooses the format:

- `.log` (candump): times absolute, in microseconds; no data length of remote frames, no content of error frames.
- `.asc` (Vector): times since the first frame, in microseconds; no content of error frames.
- `.blf` (Vector): times absolute, in nanoseconds; from the first frame on where that lies before 1990, as in virtual
  time.
- `.trc` (PEAK, version 2.1): times absolute, in microseconds; no error frames.
- `.mf4` (ASAM MDF 4, where asammdf is installed): times absolute, in microseconds; data, remote and error frames are
  three tables, so that among equal times their order is lost.

No format but `.log` is equal byte for byte when written twice: the others carry the date or the name of the file.
python-can's CSV is not offered: it loses whether a frame was CAN FD.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, Protocol

import can
from can.util import channel2int, len2dlc

from can_bridge.bus.conversion import to_message
from can_bridge.logs.log_reader import MF4, NEEDS_ASAMMDF, check_suffix
from can_bridge.wire.frame import Frame
from contract.atomic import replacing
from contract.errors import BusError, StillwakeError


class _Writer(Protocol):
    """The part of python-can's writers that is used here."""

    def on_message_received(self, msg: can.Message) -> None: ...

    def stop(self) -> None: ...


class _TrcWriter(can.TRCWriter):
    """python-can's, which leaves CAN FD and remote frames out, with them.

    Types after PEAK's "PCAN trace file format", version 2.1: DT, FD, FB (bit-rate switch), FE (error state), BI (both),
    RR. python-can reads FE and BI the other way round.
    """

    def on_message_received(self, msg: can.Message) -> None:
        """Append one line; error frames are left out, since theirs has registers that python-can does not show."""
        if msg.is_error_frame:
            return
        if self.first_timestamp is None:
            self.first_timestamp = msg.timestamp
        channel = channel2int(msg.channel)
        self.msgnr += 1
        line = (
            f"{self.msgnr:>7} {(msg.timestamp - self.first_timestamp) * 1000:13.3f} {_trc_type(msg)} "
            f"{self.channel if channel is None else channel + 1:>2} "
            f"{msg.arbitration_id:0{8 if msg.is_extended_id else 4}X} {'Rx' if msg.is_rx else 'Tx'} -  "
            f"{len2dlc(msg.dlc):<4} {msg.data.hex(' ').upper()}"
        )
        self.log_event(line.rstrip(), msg.timestamp)


_WRITERS: Final[Mapping[str, Callable[[Path], _Writer]]] = {
    ".log": can.CanutilsLogWriter,
    ".asc": can.ASCWriter,
    ".blf": can.BLFWriter,
    ".trc": _TrcWriter,
    MF4: can.MF4Writer,
}


@contextmanager
def recording(path: Path) -> Iterator[Callable[[Frame], None]]:
    """Yield a function that appends a frame; the file appears when the block succeeds, and not otherwise.

    Frames must come in the order of their timestamps: the writers stamp an earlier one with the time before it.

    Raises:
        StillwakeError: for another ending, or if the place cannot be written.
    """
    with recording_messages(path) as append:
        yield lambda frame: append(to_message(frame))


@contextmanager
def recording_messages(path: Path) -> Iterator[Callable[[can.Message], None]]:
    """The same for messages of python-can, remote and error frames among them."""
    suffix = path.suffix.lower()
    if suffix not in _WRITERS:
        raise StillwakeError(f"frame log {path}: name must end in {', '.join(_WRITERS)}")
    check_suffix(path)
    with replacing(path) as temporary:
        writer = _opened(_WRITERS[suffix], path, temporary)
        try:
            yield writer.on_message_received
        finally:
            writer.stop()


def loss_of(path: Path, message: can.Message) -> str:
    """What this file's format does not keep of a message, in words; empty if it keeps all."""
    suffix = path.suffix.lower()
    if message.is_error_frame:
        if suffix == ".trc":
            return "error frames"
        return "contents of error frames" if suffix in (".log", ".asc") and message.data else ""
    if message.is_remote_frame and suffix == ".log" and message.dlc:
        return "data lengths of remote frames"
    return ""


def _opened(writer_of: Callable[[Path], Any], path: Path, temporary: Path) -> _Writer:
    try:
        writer = writer_of(temporary)
    except NotImplementedError as error:
        raise BusError(f"{path}: {NEEDS_ASAMMDF}") from error
    if isinstance(writer, can.TRCWriter):
        # It writes its name into the file.
        writer.filepath = str(path)
    opened: _Writer = writer
    return opened


def _trc_type(message: can.Message) -> str:
    if message.is_remote_frame:
        return "RR"
    if not message.is_fd:
        return "DT"
    if message.bitrate_switch:
        return "BI" if message.error_state_indicator else "FB"
    return "FE" if message.error_state_indicator else "FD"
