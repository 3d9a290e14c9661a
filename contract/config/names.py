"""The names in the tree of settings: which there are, what type each has, and what a wrong one was meant to be."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from difflib import SequenceMatcher, get_close_matches
from functools import cache
from typing import Any, Literal, get_args, get_origin, get_type_hints

from contract.config.tree import Config
from contract.errors import ConfigError


def check_names(tree: Mapping[str, Any], above: str = "") -> None:
    """Refuse a tree with a name that is not in `Config`, a value for a section, or a section for a value. Raises
    ConfigError, which names what is wrong and what comes nearest to it."""
    for key, value in tree.items():
        name = f"{above}.{key}" if above else key
        if name not in _hints():
            raise ConfigError(_unknown(above, key))
        if is_dataclass(_hints()[name]):
            if not isinstance(value, Mapping):
                raise ConfigError(f"{name} is a section: write {name}.key=value")
            check_names(value, name)
        elif isinstance(value, Mapping):
            raise ConfigError(f"{name} is a value, not a section: it has no {', '.join(map(repr, value))}")


def takes_text(name: str) -> bool:
    """Whether the setting of that dotted name holds text; False for a name that does not exist."""
    hint = _hints().get(name)
    words = get_args(hint)
    return hint is str or str in words or (get_origin(hint) is Literal and all(isinstance(one, str) for one in words))


def _unknown(section: str, key: str) -> str:
    """The error for a section, or for the tree if it is "", without such a key, with the nearest ones."""
    inside = [name.rpartition(".")[2] for name in _hints() if name.rpartition(".")[0] == section]
    if not section:
        inside.sort(key=lambda name: -SequenceMatcher(None, key, name).ratio())
        return f"there is no section {key!r}; the sections are {', '.join(inside)}"
    elsewhere = [name for name, hint in _hints().items() if name.endswith(f".{key}") and not is_dataclass(hint)]
    if meant := elsewhere or get_close_matches(key, inside, n=1, cutoff=0.5):
        return f"{section} has no {key!r}: did you mean {' or '.join(meant)}?"
    return f"{section} has no {key!r}; it has {', '.join(inside)}"


@cache
def _hints() -> Mapping[str, Any]:
    """The type without metadata of every setting, and the dataclass of every section, by dotted name."""
    return dict(_walk(Config, ""))


def _walk(group: Any, above: str) -> Iterator[tuple[str, Any]]:
    hints = get_type_hints(group)
    for field in fields(group):
        hint = hints[field.name]
        yield f"{above}{field.name}", hint
        if is_dataclass(hint):
            yield from _walk(hint, f"{above}{field.name}.")
