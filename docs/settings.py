"""Write `docs/reference/settings.md` from the tree of settings: `make docs`.

Values, rules and meanings are those of the dataclasses in `contract/config/`: a default is the paper's, the release's
value is in `contract/config/release.toml`, a rule is in the field's type, and a meaning is the text below the field.
"""

import ast
import inspect
import sys
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Literal, get_args, get_origin, get_type_hints

from contract.config.loading import load_config
from contract.config.rules import Rule
from contract.config.tree import Config

ROOT: Final = Path(__file__).resolve().parents[1]
PAGE: Final = ROOT / "docs" / "reference" / "settings.md"

_HEAD: Final = """# Settings

For everyone who sets something: every setting of the tree, by the name that `--set NAME=VALUE` and a TOML file
(`--config FILE.toml`) use. A default is the paper's number where the paper has one; the release's is given where it
differs. Lengths are in W, times in t_c, actions a = jet flow rate in U_inf W, unless a name carries its unit. A value
outside its bounds is refused by name. `make docs` writes this page from `contract/config/`."""


@dataclass(frozen=True)
class Setting:
    """One line of a table."""

    name: str
    default: object
    release: object
    rule: str
    meaning: str


def page() -> str:
    """The whole page: a table for every group of settings."""
    parts = [_HEAD]
    for name, group, release in _groups("", Config(), load_config()):
        parts.append(f"\n## {name}\n\n{_flat(inspect.getdoc(type(group)) or '')}\n")
        parts.append("| setting | default | release | bounds | meaning |\n|---|---|---|---|---|")
        for one in settings(name, group, release):
            value = "" if one.release == one.default else _shown(one.release)
            parts.append(f"| `{one.name}` | {_shown(one.default)} | {value} | {one.rule} | {one.meaning} |")
    return "\n".join(parts) + "\n"


def settings(prefix: str, group: Any, release: Any) -> Iterator[Setting]:
    """The settings of one dataclass, without those of the groups in it."""
    hints, meanings = get_type_hints(type(group), include_extras=True), _meanings(type(group))
    for item in fields(group):
        value = getattr(group, item.name)
        if not is_dataclass(value):
            rule, meaning = _rule(hints[item.name]), meanings.get(item.name, "")
            yield Setting(f"{prefix}.{item.name}", value, getattr(release, item.name), rule, meaning)


def _groups(prefix: str, tree: Any, release: Any) -> Iterator[tuple[str, Any, Any]]:
    """Every dataclass in the tree by its dotted name, outer ones first; one without settings of its own is left out."""
    if prefix and any(not is_dataclass(getattr(tree, item.name)) for item in fields(tree)):
        yield prefix, tree, release
    for item in fields(tree):
        value = getattr(tree, item.name)
        if is_dataclass(value):
            yield from _groups(f"{prefix}.{item.name}".lstrip("."), value, getattr(release, item.name))


def _rule(hint: Any) -> str:
    """What a type allows: a rule's wording, or the words to choose from."""
    for part in get_args(hint):
        if isinstance(part, Rule):
            return part.wording
    return ", ".join(f"`{word}`" for word in get_args(hint)) if get_origin(hint) is Literal else ""


def _meanings(group: type) -> dict[str, str]:
    """The text below each field, in the source of the class and of those it extends."""
    found: dict[str, str] = {}
    for base in reversed([base for base in group.__mro__ if base is not object]):
        (node,) = ast.parse(inspect.getsource(base)).body
        body = node.body if isinstance(node, ast.ClassDef) else []
        for field, text in pairwise(body):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(text, ast.Expr):
                found[field.target.id] = _flat(str(ast.literal_eval(text.value)))
    return found


def _flat(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _shown(value: object) -> str:
    if value is None:
        return "none"
    if isinstance(value, tuple):
        return ", ".join(map(_shown, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    sys.stdout.write(f"wrote {PAGE}\n")
