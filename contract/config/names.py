"""The names in the tree of settings: which there are, what type each has, and what a wrong one was meant to be."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from difflib import SequenceMatcher, get_close_matches
from functools import cache
from typing import Any, Literal, get_args, get_origin, get_type_hints

from contract.config.tree import Config
from contract.errors import ConfigError


def check_names(tree: Mapping[str, Any]) -> None:
    """Refuse a tree with a name that is not in `Config`, a value for a section, or a section for a value.

    Raises:
        ConfigError: names what is wrong and what comes nearest to it.
    """
    _check(tree, "")


def takes_text(name: str) -> bool:
    """Whether the setting of that dotted name holds text; False for a name that does not exist."""
    hint = _settings().get(name)
    return hint is str or (get_origin(hint) is Literal and all(isinstance(word, str) for word in get_args(hint)))


def is_switch(name: str) -> bool:
    """Whether the setting of that dotted name is true or false."""
    return _settings().get(name) is bool


def _check(tree: Mapping[str, Any], above: str) -> None:
    for key, value in tree.items():
        name = f"{above}.{key}" if above else key
        if name in _sections():
            if not isinstance(value, Mapping):
                raise ConfigError(f"{name} is a section: write {name}.key=value")
            _check(value, name)
        elif name not in _settings():
            raise ConfigError(_unknown(above, key))
        elif isinstance(value, Mapping):
            raise ConfigError(f"{name} is a value, not a section: it has no {', '.join(map(repr, value))}")


def _unknown(section: str, key: str) -> str:
    """Says that a section, or the tree if it is "", has no such key, and names the nearest ones."""
    if not section:
        names = sorted((one for one in _sections() if "." not in one), key=lambda one: -_likeness(key, one))
        return f"there is no section {key!r}; the sections are {', '.join(names)}"
    inside = [name for name in (*_settings(), *_sections()) if name.rpartition(".")[0] == section]
    near = get_close_matches(key, [name.rpartition(".")[2] for name in inside], n=1, cutoff=0.5)
    elsewhere = [name for name in _settings() if name.rpartition(".")[2] == key]
    if meant := elsewhere or near:
        return f"{section} has no {key!r}: did you mean {' or '.join(meant)}?"
    return f"{section} has no {key!r}; it has {', '.join(name.rpartition('.')[2] for name in inside)}"


def _likeness(one: str, other: str) -> float:
    return SequenceMatcher(None, one, other).ratio()


@cache
def _settings() -> Mapping[str, Any]:
    """Dotted name of every setting, and its type without metadata."""
    return {name: hint for name, hint in _walk(Config, "") if not is_dataclass(hint)}


@cache
def _sections() -> Mapping[str, Any]:
    """Dotted name of every section, and its dataclass."""
    return {name: hint for name, hint in _walk(Config, "") if is_dataclass(hint)}


def _walk(group: Any, above: str) -> Iterator[tuple[str, Any]]:
    hints = get_type_hints(group)
    for field in fields(group):
        hint = hints[field.name]
        yield f"{above}{field.name}", hint
        if is_dataclass(hint):
            yield from _walk(hint, f"{above}{field.name}.")
