"""Signals of another node's messages in a log, by a DBC: forces that a balance put on the bus."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import can
import numpy as np

from can_bridge.wire.network_file import load_network
from contract.arrays import Array
from contract.errors import DatasetError

if TYPE_CHECKING:
    from cantools.database.can import Message


@dataclass(frozen=True, kw_only=True, eq=False)
class Signal:
    """One signal in a log.

    Attributes:
        time_s: of its frames on the log's clock, in the order of the log, (n,).
        values: in the DBC's unit, (n,).
    """

    time_s: Array
    values: Array


def signals_of(
    log: Path, messages: Iterable[can.Message], dbc: Path, wanted: Mapping[str, str]
) -> tuple[dict[str, Signal], float]:
    """The wanted signals and the time of the log's first message.

    Args:
        log: for errors.
        messages: of the log.
        dbc: the file that describes them.
        wanted: by the name here, "Message.Signal".

    Raises:
        DatasetError: the DBC lacks one, or the log has no frame of it.
        BusError: the DBC cannot be read, or cantools is not installed.
    """
    places = {name: _place(dbc, name, text) for name, text in wanted.items()}
    described = {message.name: message for message in load_network(dbc).messages}
    specs: dict[tuple[int, bool], Message] = {}
    for name, (message_name, signal) in places.items():
        spec = described.get(message_name)
        if spec is None:
            raise DatasetError(f"{dbc}: no message {message_name!r} for {name}; it has {', '.join(sorted(described))}")
        if signal not in (one.name for one in spec.signals):
            signals = ", ".join(one.name for one in spec.signals)
            raise DatasetError(f"{dbc}: message {message_name} has no signal {signal!r} for {name}; it has {signals}")
        specs[spec.frame_id, spec.is_extended_frame] = spec
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in wanted}
    first: float | None = None
    for message in messages:
        first = message.timestamp if first is None else first
        spec = specs.get((message.arbitration_id, message.is_extended_id))
        if spec is None or message.is_error_frame or message.is_remote_frame:
            continue
        for name, (message_name, signal) in places.items():
            value = _value(spec, bytes(message.data), signal) if spec.name == message_name else None
            if value is not None:
                found[name].append((message.timestamp, value))
    for name, pairs in found.items():
        if not pairs:
            raise DatasetError(f"{log}: has no frame with {wanted[name]}, which is to be {name}")
    columns = {name: np.array(pairs).T for name, pairs in found.items()}
    assert first is not None
    return {name: Signal(time_s=time_s, values=values) for name, (time_s, values) in columns.items()}, first


def _place(dbc: Path, name: str, text: str) -> tuple[str, str]:
    message, dot, signal = text.partition(".")
    if not (dot and message and signal):
        raise DatasetError(f"{dbc}: {name}={text}: write {name}=MESSAGE.SIGNAL with names of the DBC")
    return message, signal


def _value(spec: "Message", data: bytes, signal: str) -> float | None:
    """The signal in these bytes; None if they do not have it, as a frame of another multiplexer value."""
    try:
        decoded = spec.decode(data, decode_choices=False)
    except Exception:  # noqa: BLE001  (cantools raises errors of many kinds for bytes of another length)
        return None
    value = decoded.get(signal) if isinstance(decoded, dict) else None
    return float(value) if isinstance(value, int | float) else None
