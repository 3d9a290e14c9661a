"""The tables of `docs/reference/can-messages.md`, from `contract/stillwake.dbc`."""

import re
from collections.abc import Iterable
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Final

from cantools.database import Database
from cantools.database.can import Message
from cantools.database.can.signal import Signal

from can_bridge.wire.message_sets import CLASSIC, FD, SECURED, SETS
from docs.table import table

DBC: Final = Path(__file__).resolve().parents[1] / "contract" / "stillwake.dbc"
_HEADER: Final = ("E2E_CRC", "E2E_Counter")
_TRAILER: Final = ("Freshness", "MAC")


@cache
def _messages() -> tuple[tuple[Message, ...], ...]:
    """Return the forms of each message in CAN FD, classic CAN and authenticated CAN FD."""
    dbc = Database()
    dbc.add_dbc_string(DBC.read_text(encoding="utf-8"))
    sets = (dbc.get_message_by_name(spec.name) for one in (FD, CLASSIC, SECURED) for spec in one.specs)
    in_order = list(sets)
    count = len(in_order) // len(SETS)
    return tuple(tuple(in_order[number::count]) for number in range(count))


def sets() -> str:
    """Return a table with the name, identifier, length and E2E data ID of each message in each set."""
    heads = ("CAN FD: id, bytes, data ID", "classic CAN", "authenticated CAN FD", "from")
    return table(heads, ((*map(_identity, twins), ", ".join(twins[0].senders)) for twins in _messages()))


def _identity(message: Message) -> str:
    data_id = message.dbc.attributes["E2EDataID"].value if message.dbc else 0
    return f"`{message.name}` {message.frame_id:#x}, {message.length}, {data_id:#x}"


def signals() -> str:
    """Return a table of the E2E header, and a section for each message with its signals in CAN FD and classic CAN."""
    parts = [table(("signal", "CAN FD", "classic CAN", "meaning"), _rows(_messages()[0], _HEADER))]
    for twins in _messages():
        names = [signal.name for signal in twins[0].signals if signal.name not in _HEADER]
        parts.append(f"## {twins[0].name}\n\n{twins[0].comment}")
        parts.append(table(("signal", "CAN FD", "classic CAN", "meaning"), _rows(twins, names)))
    return "\n\n".join(parts)


def trailers() -> str:
    """Return a table with the first bits of the freshness value and the authentication code in each message."""
    found = [[twins[2].get_signal_by_name(name) for name in _TRAILER] for twins in _messages()]
    means = (f"`{one.name}` ({_type(one)}): {one.comment}" for one in found[0])
    rows = ((twins[2].name, *(str(one.start) for one in pair)) for twins, pair in zip(_messages(), found, strict=True))
    return "\n\n".join((table(("message", *_TRAILER), rows), *means))


def values() -> str:
    """Return a list of the modes' and reasons' numbers and names."""
    places = {"Mode": _messages()[2][0], "Reason": _messages()[3][0]}
    return "\n\n".join(f"`{name}`: {_choices(one.get_signal_by_name(name))}." for name, one in places.items())


def _choices(signal: Signal) -> str:
    return ", ".join(f"{value} {text}" for value, text in sorted((signal.choices or {}).items()))


def _rows(twins: tuple[Message, ...], names: Iterable[str]) -> Iterable[tuple[str, ...]]:
    """Return a table row for each signal; signals whose names differ only in a number share a row."""
    for _, group in groupby(names, key=lambda name: name.rstrip("0123456789")):
        same = list(group)
        fd, classic = ([one for one in message.signals if one.name in same] for message in twins[:2])
        name = f"`{same[0]}`" if len(same) == 1 else f"`{same[0]}` to `{same[-1]}`"
        yield name, _place(fd), _place(classic) if classic else "none", _meaning(fd, classic)


def _place(found: list[Signal]) -> str:
    """Return the first bits of the signals that share a row, and the type and resolution of these signals."""
    one = found[0]
    step = f", {one.scale:g} {one.unit or ''}".rstrip() if one.unit or one.scale != 1 else ""
    return f"{'/'.join(str(signal.start) for signal in found)}, {_type(one)}{step}"


def _type(one: Signal) -> str:
    order = "" if one.byte_order == "little_endian" else ", big-endian"
    return f"{'int' if one.is_signed else 'uint'}{one.length}{order}"


def _meaning(fd: list[Signal], classic: list[Signal]) -> str:
    """Return the CAN FD signal's comment from the DBC, and the parts of the classic signal's comment that differ from
    it."""
    text, other = (_comment(found) for found in (fd, classic or fd))
    added = [part for part in re.split(r"(?<=[.;,]) ", other) if part.rstrip(".;,") not in text]
    return f"{text} Classic: {' '.join(added).rstrip(';,')}" if added else text


def _comment(found: list[Signal]) -> str:
    one = found[0]
    given = {"E2E_CRC": "E2E checksum.", "E2E_Counter": "E2E counter, one more in every frame."}
    text = str(one.comment or given[one.name]).replace("; stays at its largest value.", ".")
    return text if len(found) == 1 else re.sub(r"\b([A-Z][a-z]+)0\b", r"\1N", text)


def parts() -> dict[str, str]:
    """Return the generated parts of the page by their names."""
    return {"message_sets": sets(), "signals": signals(), "trailers": trailers(), "signal_values": values()}
