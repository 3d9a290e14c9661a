"""Typed values from plain trees of TOML and JSON, by msgspec; errors name the place, its value and what is right."""

import re
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, Final, Literal, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from contract.errors import ConfigError
from contract.printable import quoted, shown

T = TypeVar("T")

LONGEST_SHOWN: Final = 60
"""Characters of a value in an error."""

_KINDS: Final = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bool": "true or false",
    "null": "left out",
    "array": "a list",
    "object": "a table",
}
_EXPECTED: Final = re.compile(r"Expected `([a-z |]+)`( of length \d+)?")
_STEP: Final = re.compile(r"\.(\w+)|\[(\d+)\]")


def typed(tree: object, kind: type[T], *, complete: bool = False) -> T:
    """The tree as a dataclass, with whole numbers as floats and lists as tuples where the fields' types are. Raises
    ConfigError if a name is unknown or missing, or a value has another type. `complete` states whether every field must
    be there, also those with defaults."""
    _check_names(tree, kind, "", complete=complete)
    try:
        value = msgspec.convert(tree, kind)
    except msgspec.ValidationError as error:
        wording, _, place = str(error).removesuffix("`").partition(" - at `$")
        wrong, hint = tree, kind
        for name, index in _STEP.findall(place):
            wrong = wrong[name or int(index)]  # type: ignore[index]  # msgspec has been there
            hint = get_type_hints(hint).get(name) if is_dataclass(hint) else None  # type: ignore[assignment]
        raise ConfigError(f"{place.lstrip('.')} = {quoted(wrong, LONGEST_SHOWN)}: {_right(wording, hint)}") from error
    _set_in_order(value)
    return value


def _right(wording: str, hint: Any) -> str:
    """What a value must be, from the words of msgspec and the field's type."""
    if get_origin(hint) is Literal:
        *most, last = map(repr, get_args(hint))
        return f"must be {', '.join(most)} or {last}"
    if expected := _EXPECTED.match(wording):
        kinds = " or ".join(_KINDS.get(name, name) for name in expected[1].split(" | "))
        return f"must be {kinds}{expected[2] or ''}"
    return shown(wording)


def _check_names(tree: object, kind: type, above: str, *, complete: bool) -> None:
    if isinstance(tree, list):
        for place, item in enumerate(tree):
            _check_names(item, kind, f"{above.removesuffix('.')}[{place}].", complete=complete)
    if not isinstance(tree, Mapping):
        return  # for msgspec to refuse, or None
    hints = get_type_hints(kind)
    names = {item.name for item in fields(kind)}
    needed = {item.name for item in fields(kind) if complete or item.default is item.default_factory is MISSING}
    if unknown := tree.keys() - names:
        raise ConfigError(f"{above}{shown(min(unknown))} is unknown: must be one of {', '.join(sorted(names))}")
    if missing := needed - tree.keys():
        raise ConfigError(f"{above}{min(missing)} is missing")
    for name in names & tree.keys():
        if (part := _part_of(hints[name])) is not None:
            _check_names(tree[name], part, f"{above}{name}.", complete=complete)


def _set_in_order(value: object) -> None:
    """Give `vars` all fields in their order: msgspec sets those in the tree, in the tree's order."""
    if isinstance(value, list | tuple):
        for item in value:
            _set_in_order(item)
    elif is_dataclass(value):
        held = {item.name: getattr(value, item.name) for item in fields(value)}
        vars(value).clear()
        vars(value).update(held)
        for item in held.values():
            _set_in_order(item)


def _part_of(hint: Any) -> Any:
    """The dataclass in a field's type, alone, in a list or where the value is not None; None if there is none."""
    if get_origin(hint) is Mapping:
        return None  # its keys are names of the user's
    return next((part for part in (hint, *get_args(hint)) if isinstance(part, type) and is_dataclass(part)), None)
