"""Frames of any DBC file as named signals, by cantools."""

from pathlib import Path
from typing import TYPE_CHECKING

from can_bridge.tools import signals
from can_bridge.tools.signals import Decoded, Decoder, Signal
from can_bridge.wire.frame import Frame
from can_bridge.wire.network_file import load_network

if TYPE_CHECKING:
    from cantools.database.can import Message


def decoder_of(dbc: Path | None) -> Decoder:
    """Our own messages, and those of a DBC file, which come first: it may give our identifiers another meaning.

    Raises:
        BusError: if the file cannot be read as a DBC, or cantools is not installed.
    """
    if dbc is None:
        return signals.decode
    messages = {(one.frame_id, bool(one.is_extended_frame)): one for one in load_network(dbc).messages}

    def decode(frame: Frame) -> Decoded | None:
        own = signals.decode(frame)
        message = messages.get((frame.frame_id, frame.is_extended))
        # Our own DBC names our own messages, whose protection we can check.
        if message is None or (own is not None and own.name == message.name):
            return own
        return Decoded(name=message.name, signals=_signals(message, frame.data))

    return decode


def _signals(message: "Message", data: bytes) -> tuple[Signal, ...]:
    try:
        values = message.decode_simple(data, decode_choices=False, allow_truncated=True)
    except Exception:  # noqa: BLE001  (any bytes may come over a bus; cantools raises errors of many kinds on some)
        return ()
    signals = []
    for name, value in values.items():
        if not isinstance(value, int | float):
            continue
        signal = message.get_signal_by_name(name)
        choice = signal.choices.get(int(value)) if signal.choices and float(value).is_integer() else None
        signals.append(
            Signal(name=name, value=value, unit=signal.unit or "", text="" if choice is None else str(choice))
        )
    return tuple(signals)
