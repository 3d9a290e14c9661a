"""Faults as a line of text, for settings and the command line.

    drop:probability=0.1@5..10         a tenth of the frames, from 5 s until before 10 s
    flip_bits:bits=2,at=receive@5..    from 5 s on
    drop:probability=1,frame_ids=0x120+0x130
    disconnect

A fault is called by its section, and its parameters by their fields.
"""

from dataclasses import MISSING, fields
from math import inf
from typing import Any, Final, Literal, get_args, get_origin, get_type_hints

from can_bridge.bus.faults.babble import Babble
from can_bridge.bus.faults.clocks import ClockDrift
from can_bridge.bus.faults.connection import Disconnect, SlowConsumer
from can_bridge.bus.faults.content import FlipBits, StuckAt
from can_bridge.bus.faults.copies import Duplicate
from can_bridge.bus.faults.fault import Fault
from can_bridge.bus.faults.loss import BurstLoss, Drop
from can_bridge.bus.faults.timing import Delay, Reorder
from contract.errors import ConfigError

KINDS: Final[dict[str, type[Fault]]] = {
    kind.section: kind
    for kind in (
        Drop,
        BurstLoss,
        Duplicate,
        Delay,
        Reorder,
        FlipBits,
        StuckAt,
        Babble,
        Disconnect,
        SlowConsumer,
        ClockDrift,
    )
}
"""Every fault of a port, by the name that texts use."""

_SPAN: Final = ("start_s", "end_s")


def parse_fault(text: str) -> Fault:
    """The fault that a text describes.

    Raises:
        ConfigError: naming the text, and what is not known, missing, of another type or out of its bounds.
    """
    head, at, span = text.partition("@")
    name, _, parameters = head.partition(":")
    kind = KINDS.get(name.strip())
    if kind is None:
        raise ConfigError(f"fault {text!r}: no fault {name.strip()!r}; there are {', '.join(KINDS)}")
    values: dict[str, Any] = dict(zip(_SPAN, _span(span, text), strict=True)) if at else {}
    hints = get_type_hints(kind)
    known = [field.name for field in fields(kind) if field.name not in _SPAN]
    for item in filter(None, parameters.split(",")):
        key, equals, value = (part.strip() for part in item.partition("="))
        if key not in known or not equals:
            raise ConfigError(f"fault {text!r}: {item!r} must be NAME=VALUE with a name of {', '.join(known)}")
        try:
            values[key] = _value(value, hints[key])
        except ValueError:
            raise ConfigError(f"fault {text!r}: {key} = {value!r} must be {_wording(hints[key])}") from None
    missing = [field.name for field in fields(kind) if field.default is MISSING and field.name not in values]
    if missing:
        raise ConfigError(f"fault {text!r}: {kind.section} needs {', '.join(missing)}")
    return kind(**values)


def _span(text: str, whole: str) -> tuple[float, float]:
    start, dots, end = text.strip().removesuffix("s").partition("..")
    try:
        if dots:
            return float(start or 0.0), float(end or inf)
    except ValueError:
        pass
    raise ConfigError(f"fault {whole!r}: {text!r} must be START..END in seconds, either of them may be left out")


def _value(text: str, hint: Any) -> Any:
    """Raises ValueError if the text is not of the type."""
    if get_origin(hint) is tuple:
        return tuple(int(part, 0) for part in text.split("+"))
    if get_origin(hint) is Literal:
        if text not in get_args(hint):
            raise ValueError
        return text
    if hint is bool:
        if text not in ("true", "false"):
            raise ValueError
        return text == "true"
    return int(text, 0) if hint is int else float(text)


def _wording(hint: Any) -> str:
    if get_origin(hint) is tuple:
        return "whole numbers with + between them"
    if get_origin(hint) is Literal:
        return " or ".join(get_args(hint))
    return {bool: "true or false", int: "a whole number"}.get(hint, "a number")
