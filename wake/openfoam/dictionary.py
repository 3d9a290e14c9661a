"""OpenFOAM's text: dictionaries, lists and the header that every file needs."""

from collections.abc import Mapping, Sequence
from typing import Any

from contract.arrays import Array


def document(kind: str, name: str, body: str) -> str:
    """A file of OpenFOAM class `kind`."""
    header = block("FoamFile", {"version": "2.0", "format": "ascii", "class": kind, "object": name})
    return f"{header}\n{body}\n"


def dictionary(name: str, entries: Mapping[str, Any]) -> str:
    """A dictionary file."""
    return document("dictionary", name, _entries(entries, ""))


def block(name: str, entries: Mapping[str, Any], indent: str = "") -> str:
    """A named sub-dictionary."""
    return f"{indent}{name}\n{indent}{{\n{_entries(entries, indent + '    ')}{indent}}}\n"


def vectors(xy: Array) -> str:
    """A list of vectors in the plane z = 0, from (n, 2)."""
    return numbers([f"({x:.17g} {y:.17g} 0)" for x, y in xy])


def scalars(values: Array) -> str:
    """A list of numbers, from (n,)."""
    return numbers([f"{value:.17g}" for value in values])


def numbers(items: Sequence[str]) -> str:
    """A list with its length in front."""
    return "\n".join([str(len(items)), "(", *items, ")"])


def _entries(entries: Mapping[str, Any], indent: str) -> str:
    lines = []
    for key, value in entries.items():
        if isinstance(value, Mapping):
            lines.append(block(key, value, indent))
        else:
            lines.append(f"{indent}{key} {_value(value)};\n")
    return "".join(lines)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, tuple | list):
        return f"({' '.join(_value(item) for item in value)})"
    return str(value)
