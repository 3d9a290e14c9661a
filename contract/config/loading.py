"""Configuration from TOML files and `key.path=value` overrides."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import dacite

from contract.config.tree import Config
from contract.errors import ConfigError

RELEASE = "release"
"""Name of the packaged settings the shipped bundle was made with."""
PAPER = "paper"
"""Name of the bare defaults."""
BASE_KEY = "base"
"""In a TOML file: which of the two it goes on top of."""


@dataclass(frozen=True, kw_only=True)
class Loaded:
    """Settings, and which of them a user asked for.

    Attributes:
        config: all settings.
        in_file, in_overrides: dotted names of those in the TOML file and among the overrides.
    """

    config: Config
    in_file: frozenset[str] = frozenset()
    in_overrides: frozenset[str] = frozenset()

    @property
    def given(self) -> frozenset[str]:
        """Dotted names of every setting that the user gave, such as "mpc.weights.lift"."""
        return self.in_file | self.in_overrides


def load_config(path: Path | None = None, overrides: Sequence[str] = ()) -> Config:
    """The settings of `load`, without where they come from."""
    return load(path, overrides).config


def load(path: Path | None = None, overrides: Sequence[str] = (), *, base: Config | None = None) -> Loaded:
    """The release's settings, with those of a TOML file and then the overrides on top.

    Args:
        path: a TOML file; its first line may be `base = "paper"`, to go on top of the paper's settings instead.
        overrides: `section.key=value` strings, the value in TOML syntax; a bare word is a string, because shells
            take the quotation marks away.
        base: what the file and the overrides go on top of, in place of the release's settings.

    Raises:
        ConfigError: unreadable file, unknown key, wrong type or value out of range.
    """
    tree = _parsed(files("contract.config").joinpath(f"{RELEASE}.toml")) if base is None else to_tree(base)
    asked = {} if path is None else _parsed(path)
    chosen = asked.pop(BASE_KEY, RELEASE)
    if chosen not in (RELEASE, PAPER):
        raise ConfigError(f"configuration {path}: {BASE_KEY} = {chosen!r}: must be {PAPER!r} or {RELEASE!r}")
    if chosen == PAPER:
        tree = {}
    changes: dict[str, Any] = {}
    for text in overrides:
        _apply(changes, text)
    for change in (asked, changes):
        _merge(tree, change)
    return Loaded(config=from_tree(tree), in_file=frozenset(_leaves(asked)), in_overrides=frozenset(_leaves(changes)))


def from_tree(tree: Mapping[str, Any]) -> Config:
    """A validated Config from nested mappings; missing keys take the paper's values."""
    _refuse_booleans(tree)
    try:
        return dacite.from_dict(Config, tree, config=dacite.Config(strict=True, type_hooks={float: as_float}))
    except dacite.DaciteError as error:
        raise ConfigError(f"configuration: {describe_error(error)}") from error


def describe_error(error: dacite.DaciteError) -> str:
    """What dacite found wrong, with the choices where a value must be one of some."""
    if isinstance(error, dacite.WrongTypeError) and get_origin(error.field_type) is Literal:
        *most, last = map(repr, get_args(error.field_type))
        return f"{error.field_path} = {error.value!r}: must be {', '.join(most)} or {last}"
    return str(error)


def to_tree(config: Config) -> dict[str, Any]:
    """Nested plain values, accepted back by `from_tree`."""
    return asdict(config)


def as_float(value: object) -> object:
    """A float for a whole number, anything else as it is: TOML and JSON write 1 where 1.0 is meant."""
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _refuse_booleans(tree: Mapping[str, Any], above: str = "") -> None:
    # No setting is a boolean, and Python would take true for the number 1.
    for key, value in tree.items():
        if isinstance(value, bool):
            raise ConfigError(f"configuration: {above}{key} = {str(value).lower()}: must not be a boolean")
        if isinstance(value, Mapping):
            _refuse_booleans(value, f"{above}{key}.")


def _parsed(source: Traversable) -> dict[str, Any]:
    try:
        return tomllib.loads(source.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(f"configuration {source}: {error}") from error


def _merge(tree: dict[str, Any], change: Mapping[str, Any]) -> None:
    """Put the change's values into the tree, section by section."""
    for key, value in change.items():
        if isinstance(value, Mapping):
            if not isinstance(tree.setdefault(key, {}), dict):
                raise ConfigError(f"configuration: {key!r} is a value, not a section: it has no {', '.join(value)}")
            _merge(tree[key], value)
        else:
            tree[key] = value


def _leaves(tree: Mapping[str, Any], above: str = "") -> Iterator[str]:
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{above}{key}.")
        else:
            yield f"{above}{key}"


def _apply(tree: dict[str, Any], text: str) -> None:
    key, separator, value = text.partition("=")
    if not separator or not key.strip():
        raise ConfigError(f"override {text!r}: write section.key=value")
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError as error:
        if not value.strip().isidentifier():
            raise ConfigError(f"override {text!r}: {value!r} is not a TOML value") from error
        parsed = value.strip()
    *sections, leaf = key.strip().split(".")
    for section in sections:
        tree = tree.setdefault(section, {})
        if not isinstance(tree, dict):
            raise ConfigError(f"override {text!r}: {section!r} is a value, not a section")
    tree[leaf] = parsed
