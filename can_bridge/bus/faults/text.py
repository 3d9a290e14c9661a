"""The conversion between faults and lines of text, for settings and the command line.

    drop:probability=0.1@5..10         a tenth of the frames is lost, from 5 s to 10 s
    flip_bits:bits=2,at=receive@5..    from 5 s on
    drop:probability=1,frame_ids=0x120+0x130
    disconnect

The name of a fault is the `section` of its class, and its parameters are the fields of the class. If a parameter has
the same name as its fault, only the parameter is written: `reynolds=700` (a disturbance of the flow).
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import MISSING, fields
from math import inf
from typing import Any, Final, Literal, TypeVar, get_args, get_origin, get_type_hints

from can_bridge.bus.faults.fault import BusFault, Instant, Span
from can_bridge.bus.faults.frame_faults import BurstLoss, Delay, Drop, Duplicate, FlipBits, Reorder, StuckAt
from can_bridge.bus.faults.node_faults import Babble, ClockDrift, Disconnect, SlowConsumer
from contract.errors import ConfigError

S = TypeVar("S", bound=Span)

_ALL: Final = (
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
BUS_FAULTS: Final[dict[str, type[BusFault]]] = {kind.section: kind for kind in _ALL}
"""The classes of all faults of a port, by the names with which a text begins."""

_SPAN: Final = ("start_s", "end_s")


def parse_fault(text: str) -> BusFault:
    """Return the fault that a text describes. Raises ConfigError, which states the text and the part that is wrong."""
    return parse_described(text, BUS_FAULTS, "fault")


def parse_described(text: str, kinds: Mapping[str, type[S]], noun: str) -> S:
    """Return the value that a text describes, of the classes `kinds` by name; `noun` names it in the ConfigError."""
    described = f"{noun} {text!r}"
    head, at, span = text.partition("@")
    name, colon, parameters = head.partition(":")
    if not colon and "=" in name:
        parameters, name = name, name.partition("=")[0]
    kind = kinds.get(name.strip())
    if kind is None:
        raise ConfigError(f"{described}: no {noun} {name.strip()!r}; there are {', '.join(kinds)}")
    values: dict[str, Any] = dict(zip(_SPAN, _span(span, described, kind), strict=True)) if at else {}
    hints = get_type_hints(kind)
    known = [field.name for field in fields(kind) if field.name not in _SPAN]
    for item in filter(None, parameters.split(",")):
        key, equals, value = (part.strip() for part in item.partition("="))
        if key not in known or not equals:
            wording = f"NAME=VALUE with a name of {', '.join(known)}" if known else "left out"
            raise ConfigError(f"{described}: {item!r} must be {wording}")
        if key in values:
            raise ConfigError(f"{described}: {key} is given twice")
        try:
            values[key] = _value(value, hints[key])
        except ValueError:
            raise ConfigError(f"{described}: {key} = {value!r} must be {_wording(hints[key])}") from None
    missing = [field.name for field in fields(kind) if field.default is MISSING and field.name not in values]
    if missing:
        raise ConfigError(f"{described}: {kind.section} needs {', '.join(missing)}")
    return kind(**values)


def text_of(described: Span) -> str:
    """Return the shortest text from which `parse_described` reads this value."""
    parts = []
    for field in fields(described):
        value = getattr(described, field.name)
        if field.name not in _SPAN and value != field.default:
            parts.append(f"{field.name}={_written(value)}")
    section = described.section
    alone = len(parts) == 1 and parts[0].startswith(f"{section}=")
    text = parts[0] if alone else ":".join(filter(None, (section, ",".join(parts))))
    if isinstance(described, Instant):
        return f"{text}@{_written(described.start_s)}"
    if (described.start_s, described.end_s) == (0.0, inf):
        return text
    return f"{text}@{_written(described.start_s)}..{'' if described.end_s == inf else _written(described.end_s)}"


def _span(text: str, described: str, kind: type[Span]) -> tuple[float, float]:
    start, dots, end = text.strip().removesuffix("s").partition("..")
    instant = issubclass(kind, Instant)
    with suppress(ValueError):
        if instant and not dots:
            return float(start), inf
        if dots and not instant:
            return float(start or 0.0), float(end or inf)
    wording = "a time in seconds" if instant else "START..END in seconds; START or END may be left out"
    raise ConfigError(f"{described}: {text!r} must be {wording}")


def _value(text: str, hint: Any) -> Any:
    if get_origin(hint) is tuple:
        return tuple(_value(part, get_args(hint)[0]) for part in text.split("+"))
    if get_origin(hint) is Literal:
        if text not in get_args(hint):
            raise ValueError
        return text
    if hint is bool:  # any other text raises ValueError
        return bool(("false", "true").index(text))
    if hint is str:
        return text
    return int(text, 0) if hint is int else float(text)


def _written(value: Any) -> str:
    if isinstance(value, tuple):
        return "+".join(map(_written, value))
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value
    short = f"{value:g}"
    return short if float(short) == value else repr(value)


def _wording(hint: Any) -> str:
    if get_origin(hint) is tuple:
        return f"{'names' if get_args(hint)[0] is str else 'whole numbers'} with + between them"
    if get_origin(hint) is Literal:
        return " or ".join(get_args(hint))
    return {bool: "true or false", int: "a whole number"}.get(hint, "a number")
