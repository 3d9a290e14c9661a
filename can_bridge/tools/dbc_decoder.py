"""Frames of any DBC file as named signals, by cantools."""

from pathlib import Path
from typing import TYPE_CHECKING

from can_bridge.tools import signals
from can_bridge.tools.signals import Decoded, Decoder, Signal
from can_bridge.wire.frame import Frame
from contract.errors import BusError

if TYPE_CHECKING:
    from cantools.database.can import Database, Message

NEEDS_CANTOOLS = "a DBC file needs cantools: pip install 'stillwake[bus]'"


def decoder_of(dbc: Path | None) -> Decoder:
    """Our own messages, and those of a DBC file, which come first: it may give our identifiers another meaning.

    Raises:
        BusError: if the file cannot be read as a DBC, or cantools is not installed.
    """
    if dbc is None:
        return signals.decode
    messages = {(one.frame_id, bool(one.is_extended_frame)): one for one in load_dbc(dbc).messages}

    def decode(frame: Frame) -> Decoded | None:
        own = signals.decode(frame)
        message = messages.get((frame.frame_id, frame.is_extended))
        # Our own DBC names our own messages, whose protection we can check.
        if message is None or (own is not None and own.name == message.name):
            return own
        return Decoded(name=message.name, signals=_signals(message, frame.data))

    return decode


def load_dbc(dbc: Path) -> "Database":
    """What a DBC file describes; raises BusError if it cannot be read, or cantools is not installed."""
    try:
        import cantools
    except ModuleNotFoundError as error:
        raise BusError(f"{dbc}: {NEEDS_CANTOOLS}") from error
    if not dbc.is_file():
        raise BusError(f"{dbc}: {'is a directory, must be a DBC file' if dbc.is_dir() else 'there is no such file'}")
    try:
        # The file may be of any age and encoding; what it says wrongly is its author's to hear from stricter tools.
        database: Database = cantools.database.load_file(dbc, database_format="dbc", strict=False)  # type: ignore[assignment]
    except Exception as error:
        reason = str(error).splitlines()
        raise BusError(f"{dbc}: cannot be read as a DBC ({reason[0] if reason else type(error).__name__})") from error
    return database


def _signals(message: "Message", data: bytes) -> tuple[Signal, ...]:
    try:
        values = message.decode_simple(data, decode_choices=False, allow_truncated=True)
    except Exception:  # noqa: BLE001  (any bytes may come over a bus; cantools raises errors of many kinds on some)
        return ()
    found = []
    for name, value in values.items():
        if not isinstance(value, int | float):
            continue
        signal = message.get_signal_by_name(name)
        choice = signal.choices.get(int(value)) if signal.choices and float(value).is_integer() else None
        found.append(Signal(name=name, value=value, unit=signal.unit or "", text="" if choice is None else str(choice)))
    return tuple(found)
