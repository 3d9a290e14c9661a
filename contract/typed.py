"""A reader of users' TOML files, and a converter of TOML and JSON trees to typed values (with msgspec). The text of an
error is one line with the place, the value and the allowed values."""

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, asdict, fields, is_dataclass
from importlib.resources.abc import Traversable
from typing import Any, Final, Literal, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from contract.errors import ConfigError
from contract.printable import quoted, shown

T = TypeVar("T")
LONGEST_SHOWN: Final = 60
"""Largest number of characters of a value that an error shows."""
LARGEST_FILE: Final = 2**20
"""Largest size of a file, in bytes; a file with all settings has three thousand bytes."""
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


def read_toml(source: Traversable, what: str) -> dict[str, Any]:
    """Return a TOML file's tree. Raises ConfigError with a message that begins with `what`, the kind of the file."""
    try:
        with source.open("rb") as file:
            data = file.read(LARGEST_FILE + 1)
        if len(data) > LARGEST_FILE:
            raise ConfigError(f"{what} {source}: is larger than {LARGEST_FILE} bytes")
        return tomllib.loads(data.decode("utf-8-sig"))
    except OSError as error:
        raise ConfigError(f"{what} {source}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{what} {source}: is not UTF-8 text") from error
    except (ValueError, RecursionError) as error:  # raised by tomllib, or for a NUL in the path
        raise ConfigError(f"{what} {source}: {error}") from error


def untyped(value: Any) -> dict[str, Any]:
    """Convert a dataclass to a tree that `typed` can read. Fields that are None are left out."""
    return {name: item for name, item in asdict(value).items() if item is not None}


def typed(tree: object, kind: type[T], *, complete: bool = False) -> T:
    """Convert a tree to a dataclass. Where a field's type requires it, a whole number becomes a float, and a list a
    tuple. `complete` states whether the tree must also have the fields that have defaults. Raises ConfigError if a
    name is unknown or missing, or a value has another type."""
    _check_names(tree, kind, "", complete=complete)
    try:
        value = msgspec.convert(tree, kind)
    except msgspec.ValidationError as error:
        wording, _, place = str(error).removesuffix("`").partition(" - at `$")
        wrong, hint = tree, kind
        for name, index in _STEP.findall(place):
            wrong = wrong[name or int(index)]  # type: ignore[index]  # msgspec stated this place
            hint = get_type_hints(hint).get(name) if is_dataclass(hint) else None  # type: ignore[assignment]
        raise ConfigError(f"{place.lstrip('.')} = {quoted(wrong, LONGEST_SHOWN)}: {_right(wording, hint)}") from error
    _set_in_order(value)
    return value


def _right(wording: str, hint: Any) -> str:
    """Describe the condition on a value in words, from msgspec's message and the field's type."""
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
        return  # the value is None, or msgspec refuses it
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
    """Put all fields into `vars` in declaration order; msgspec sets only the tree's fields, in the tree's order."""
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
    """Return the dataclass in a field's type, which may be optional or a list; None if there is no dataclass."""
    if get_origin(hint) is Mapping:
        return None  # the user chooses the keys of a mapping
    return next((part for part in (hint, *get_args(hint)) if isinstance(part, type) and is_dataclass(part)), None)


def differences(there: Any, here: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """List the differences of two trees as (dotted name, value in `there`, value in `here`); None if it is missing."""
    if isinstance(there, Mapping) and isinstance(here, Mapping):
        for key in sorted(there.keys() | here.keys()):
            yield from differences(there.get(key), here.get(key), f"{name}.{key}".lstrip("."))
    elif there != here:
        yield name, there, here
