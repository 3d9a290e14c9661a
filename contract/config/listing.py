"""A table of all settings. A row states a setting's value, default, unit, bounds, source and meaning.

The bounds, the unit and the default's source are in the field's type; the meaning is the text below the field.
"""

import ast
import inspect
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from itertools import pairwise
from typing import Any, Literal, get_args, get_origin, get_type_hints

from contract.config.notes import Source, Unit
from contract.config.rules import Rule
from contract.config.tree import Config


@dataclass(frozen=True, kw_only=True)
class Setting:
    """A row of the table of settings. `name` is dotted, as written after `--set`. `unit` is "" for a ratio, for text,
    or for a count whose name states what is counted. `bounds` is the condition on the value in words, or the list of
    the allowed words. `meaning` is one paragraph; "" if the name is enough."""

    name: str
    value: Any
    paper: Any
    unit: str
    bounds: str
    source: Source
    meaning: str

    @property
    def is_changed(self) -> bool:
        """Whether the setting's value differs from its default, which `paper` holds."""
        return bool(self.value != self.paper)


@dataclass(frozen=True, kw_only=True)
class Section:
    """A section of settings: dotted name, a paragraph on the meaning, and the settings that are in no subsection."""

    name: str
    meaning: str
    settings: tuple[Setting, ...]


def sections(config: Config) -> tuple[Section, ...]:
    """List a tree's sections with their settings, outer sections first; sections with only subsections are left out."""
    return tuple(_sections("", config, Config()))


def as_toml(listed: Sequence[Section], *, base: str | None = None) -> str:
    """Return the text of a TOML file from which `contract.config.loading.load` reads the listed settings unchanged.
    `base` is "paper" or "release", the settings that the file modifies; with None the file states no base. TOML cannot
    express "none": a setting that is None is left out and gets the base's value when the file is read."""
    parts = [] if base is None else [f"base = {_toml(base)}\n"]
    for section in listed:
        if held := [one for one in section.settings if one.value is not None]:
            lines = (f"{one.name.rpartition('.')[2]} = {_toml(one.value)}\n" for one in held)
            parts.append(f"[{section.name}]\n{''.join(lines)}")
    return "\n".join(parts)


def shown(value: object) -> str:
    """Format a value for display, as the shortest text that gives the same value when it is read."""
    if value is None or value == "":
        return "none"
    if isinstance(value, list | tuple):
        return ", ".join(map(shown, value))
    short = f"{value:g}" if isinstance(value, float) else str(value)
    return short if not isinstance(value, float) or float(short) == value else repr(value)


def _sections(prefix: str, tree: Any, paper: Any) -> Iterator[Section]:
    own = tuple(_settings(prefix, tree, paper)) if prefix else ()
    if own:
        yield Section(name=prefix, meaning=_flat(inspect.getdoc(type(tree)) or ""), settings=own)
    for item in fields(tree):
        value = getattr(tree, item.name)
        if is_dataclass(value):
            yield from _sections(f"{prefix}.{item.name}".lstrip("."), value, getattr(paper, item.name))


def _settings(prefix: str, group: Any, paper: Any) -> Iterator[Setting]:
    kind: type = type(group)
    hints, meanings = get_type_hints(kind, include_extras=True), _meanings(kind)
    for item in fields(group):
        value = getattr(group, item.name)
        if not is_dataclass(value):
            yield Setting(
                name=f"{prefix}.{item.name}",
                value=value,
                paper=getattr(paper, item.name),
                unit=next((part.name for part in get_args(hints[item.name]) if isinstance(part, Unit)), ""),
                bounds=_bounds(hints[item.name]),
                source=next((part for part in get_args(hints[item.name]) if isinstance(part, Source)), group.source),
                meaning=meanings.get(item.name, ""),
            )


def _bounds(hint: Any) -> str:
    for part in (hint, *get_args(hint)):
        if isinstance(part, Rule):
            return part.wording
        if get_origin(part) is Literal:
            return ", ".join(map(str, get_args(part)))
    return ""


@cache
def _meanings(group: type) -> Mapping[str, str]:
    """Return the text below each field, read from the source of the class."""
    (node,) = ast.parse(inspect.getsource(group)).body
    return {
        field.target.id: _flat(str(ast.literal_eval(text.value)))
        for field, text in pairwise(node.body if isinstance(node, ast.ClassDef) else [])
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(text, ast.Expr)
    }


def _flat(text: str) -> str:
    return " ".join(text.split())


def _toml(value: object) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return str(value).lower() if isinstance(value, bool) else repr(value)
