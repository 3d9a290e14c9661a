"""Configuration from TOML files and `key.path=value` overrides."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import dacite

from contract.config.tree import Config
from contract.errors import ConfigError

RELEASE = "release"
"""Name of the packaged settings the shipped bundle was made with; the bare defaults are the paper's."""


def load_config(path: Path | None = None, overrides: Sequence[str] = ()) -> Config:
    """The packaged release settings, or the TOML file at `path`, with overrides applied.

    Args:
        path: a TOML file; None for the release settings.
        overrides: `section.key=value` strings, the value in TOML syntax; a bare word is a string, because shells
            take the quotation marks away.

    Raises:
        ConfigError: unreadable file, unknown key, wrong type or value out of range.
    """
    source = files("contract.config").joinpath(f"{RELEASE}.toml") if path is None else path
    try:
        tree = tomllib.loads(source.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(f"configuration {path}: {error}") from error
    for text in overrides:
        _apply(tree, text)
    return from_tree(tree)


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
