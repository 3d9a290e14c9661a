"""The functions that read the settings from TOML files and `key.path=value` overrides."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass
from difflib import SequenceMatcher, get_close_matches
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, Literal, get_args, get_origin, get_type_hints

from contract.config.tree import Config
from contract.errors import ConfigError
from contract.printable import quoted
from contract.typed import LONGEST_SHOWN, read_toml, typed

_RELEASE: Final = "release"
"""Name of the packaged settings with which the shipped bundle was built."""
PAPER: Final = "paper"
"""Name of the default settings: the paper's values, where the paper states a value."""
BASE_KEY: Final = "base"
"""The key in a TOML file that states which settings the file modifies: the paper's or the release's settings."""
RETIRED: Final = {"refine.iterations": False}
"""Settings that no longer exist, each with the only value that is still accepted in a file of an earlier version."""


def check_names(tree: Mapping[str, Any], above: str = "") -> None:
    """Check that every name in a tree is in `Config`, and that no section is used as a value, and no value as a
    section. Raises ConfigError with the wrong name and the most similar correct names."""
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


def _unknown(section: str, key: str) -> str:
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
    """Return the type of every setting, without metadata, and the dataclass of every section, by dotted name."""
    return dict(_walk(Config, ""))


def _walk(group: Any, above: str) -> Iterator[tuple[str, Any]]:
    hints = get_type_hints(group)
    for field in fields(group):
        hint = hints[field.name]
        yield f"{above}{field.name}", hint
        if is_dataclass(hint):
            yield from _walk(hint, f"{above}{field.name}.")


@dataclass(frozen=True, kw_only=True)
class Loaded:
    """The loaded settings, and the dotted names of the settings that are in the TOML file or in the overrides."""

    config: Config
    in_file: frozenset[str] = frozenset()
    in_overrides: frozenset[str] = frozenset()

    @property
    def given(self) -> frozenset[str]:
        """Names of all settings that the user gave, such as "mpc.weights.lift"."""
        return self.in_file | self.in_overrides


def load_config(path: Path | None = None, overrides: Sequence[str] = ()) -> Config:
    """Return the settings that `load` returns, without the names of the settings that the user gave."""
    return load(path, overrides).config


def load(path: Path | None = None, overrides: Sequence[str] = (), *, base: Config | None = None) -> Loaded:
    """Read the release's settings, or those given as `base`, then apply a TOML file, then the overrides. If the file's
    first line is `base = "paper"`, it modifies the paper's settings. Overrides are `section.key=value` strings, with
    the value in TOML syntax; text needs no quotation marks. Raises ConfigError for an unreadable file, an unknown key,
    a wrong type or a value out of range."""
    tree = _packaged(_RELEASE) if base is None else to_tree(base)
    asked = {} if path is None else dict(without_retired(read_toml(path, "configuration")))
    chosen = asked.pop(BASE_KEY, _RELEASE)
    if chosen not in (_RELEASE, PAPER):
        raise ConfigError(f"configuration {path}: {BASE_KEY} = {_short(chosen)}: must be {PAPER!r} or {_RELEASE!r}")
    if chosen == PAPER:
        tree = {}
    _check(asked, f"configuration {path}")
    changes: dict[str, Any] = {}
    for text in overrides:
        change = _parsed_override(text)
        _check(change, f"override {_short(text)}")
        _merge(changes, change)
    _merge(tree, asked)
    _merge(tree, changes)
    in_file, in_overrides = (frozenset(name for name, _ in leaves(given)) for given in (asked, changes))
    return Loaded(config=from_tree(tree), in_file=in_file, in_overrides=in_overrides)


def training(*, quick: bool = False) -> Config:
    """Return the settings for training a model without a prior; `quick` makes the training short."""
    tree = _packaged(_RELEASE)
    for name in ("trained", "quick") if quick else ("trained",):
        _merge(tree, _packaged(name))
    return from_tree(tree)


def from_tree(tree: Mapping[str, Any]) -> Config:
    """Build a validated Config from nested mappings; missing keys get the paper's values."""
    kept = without_retired(tree)
    check_names(kept)
    return typed(kept, Config)


def without_retired(tree: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a tree without the settings in `RETIRED`. Raises ConfigError if such a setting has another value."""
    for name, value in RETIRED.items():
        section, _, key = name.partition(".")
        if not isinstance(inside := tree.get(section), Mapping) or key not in inside:
            continue
        if inside[key] != value:
            raise ConfigError(f"{name} = {_short(inside[key])}: this version has no such setting; it accepts {value}")
        tree = {**tree, section: {one: inside[one] for one in inside if one != key}}
    return tree


def to_tree(config: Config) -> dict[str, Any]:
    """Convert the settings to nested plain values, which `from_tree` accepts."""
    return asdict(config)


def _packaged(name: str) -> dict[str, Any]:
    return read_toml(files("contract.config").joinpath(f"{name}.toml"), "configuration")


def _check(tree: Mapping[str, Any], source: str) -> None:
    try:
        check_names(tree)
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from error


def _parsed_override(text: str) -> dict[str, Any]:
    name, separator, value = text.partition("=")
    *sections, key = (part.strip() for part in name.split("."))
    if not separator or not key:
        raise ConfigError(f"override {_short(text)}: write section.key=value")
    tree: dict[str, Any] = {key: _parsed_value(".".join([*sections, key]), value.strip(), text)}
    for section in reversed(sections):
        tree = {section: tree}
    return tree


def _parsed_value(name: str, value: str, text: str) -> object:
    # If the value of a text setting is not a TOML string, it is used literally, for example `bus.channel=/dev/ttyUSB0`.
    hint, words = _hints().get(name), get_args(_hints().get(name))
    is_literal = get_origin(hint) is Literal and all(isinstance(one, str) for one in words)
    as_text = hint is str or str in words or is_literal
    if not value.isprintable():
        raise ConfigError(f"override {_short(text)}: holds a character that cannot be printed")
    try:
        parsed: object = tomllib.loads(f"value = {value}")["value"]
    except (ValueError, RecursionError) as error:
        if not as_text and not value.isidentifier():
            raise ConfigError(f"override {_short(text)}: {_short(value)} is not a TOML value") from error
        parsed = value
    return value if as_text and not isinstance(parsed, str) else parsed


def _short(value: object) -> str:
    return quoted(value, LONGEST_SHOWN)


def _merge(tree: dict[str, Any], change: Mapping[str, Any]) -> None:
    for key, value in change.items():
        if isinstance(value, Mapping):
            _merge(tree.setdefault(key, {}), value)
        else:
            tree[key] = value


def leaves(tree: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (dotted name, value) for every value in nested mappings."""
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value
