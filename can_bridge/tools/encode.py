"""Messages by name and value to the protected part of a frame, as a person types them: by the DBC, with cantools.

Signals that are not named are zero.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

import contract
from can_bridge.tools.signals import PROTECTION
from can_bridge.wire.message_specs import SPECS, MessageSpec
from can_bridge.wire.network_file import load_network
from contract.errors import BusError

if TYPE_CHECKING:
    from cantools.database.can.signal import Signal

DBC: Final = Path(contract.__file__).with_name("stillwake.dbc")
_SPECS: Final = {spec.name: spec for spec in SPECS}
_read_once = cache(load_network)


def encode(name: str, assignments: Sequence[str]) -> tuple[MessageSpec, bytes]:
    """The message's specification and its bytes with an empty E2E header. Raises BusError for an unknown message or
    signal, or a value that the wire cannot carry; or cantools is missing.

    Args:
        name: of one of our messages, as the DBC has it.
        assignments: "signal=value"; a value is a number in the signal's unit, or a name from its table.
    """
    if name not in _SPECS:
        names = ", ".join(_SPECS)
        raise BusError(f"{name}: is none of {names}; `python -m can.player` sends other frames, from a log")
    message = _read_once(DBC).get_message_by_name(name)
    from cantools.database import EncodeError

    signals = {one.name: one for one in message.signals}
    known = [signal for signal in signals if signal not in PROTECTION]
    values: dict[str, float | str] = dict.fromkeys(signals, 0)
    for text in assignments:
        signal, equals, value = text.partition("=")
        if signal in PROTECTION:
            raise BusError(f"{text}: {signal} is filled in by the sender; --counter names the first counter")
        if not equals or signal not in known:
            raise BusError(f"{text}: must be SIGNAL=VALUE with one of {', '.join(known)}")
        values[signal] = _value(text, signals[signal], value)
    try:
        data = message.encode(values, strict=True)
    except (EncodeError, ValueError, OverflowError) as error:
        raise BusError(f"{name} cannot be sent: {error}") from error
    spec = _SPECS[name]
    return spec, data[: spec.protected]


def _value(text: str, signal: "Signal", value: str) -> float | str:
    """A name as it is, or the number."""
    names = [str(one) for one in (signal.choices or {}).values()]
    if value in names:
        return value
    try:
        return int(value, 0)
    except ValueError:
        pass
    try:
        number = float(value)
    except ValueError:
        others = f", or one of {', '.join(names)}" if names else ""
        raise BusError(f"{text}: must be a number{others}") from None
    if not signal.unit and not number.is_integer():
        raise BusError(f"{text}: must be a whole number")
    return number
