"""The public definitions of a module. They are read from the source without an import, so that no extra is needed.

Names that begin with an underscore are private. Constants without a docstring are left out.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final, Literal

from docs.site.signatures import Function, Names, annotation, arguments, fields

Kind = Literal["function", "class", "exception", "method", "property", "attribute", "data"]

PACKAGES: Final = ("contract", "wake", "train", "export", "can_bridge", "ecu", "firmware_sim")
"""The packages in the API. The first package is the one that all others import."""
_PROPERTIES: Final = ("property", "cached_property")


def is_ours(name: str) -> bool:
    """Return whether a dotted name begins with a package of the API."""
    return name.partition(".")[0] in PACKAGES


@dataclass(frozen=True, kw_only=True)
class Member:
    """A public definition in a module or class. `kind` is the name of Sphinx's directive for Python, with `options`;
    `signature` is the text that follows the name, such as "(x: int) -> str"; `docstring` is "" if a function or a class
    has none; `members` are the definitions in a class."""

    kind: Kind
    name: str
    signature: str = ""
    options: tuple[str, ...] = ()
    docstring: str = ""
    members: tuple["Member", ...] = ()


@dataclass(frozen=True, kw_only=True)
class Module:
    docstring: str
    members: tuple[Member, ...]


def read(path: Path, name: str) -> Module:
    """Return a module's docstring and public definitions, in the order of the source."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    members = tuple(_members(tree.body, _names(tree, name), inside=False))
    return Module(docstring=ast.get_docstring(tree) or "", members=members)


def _names(tree: ast.Module, module: str) -> Names:
    names = {node.name: f"{module}.{node.name}" for node in tree.body if isinstance(node, ast.ClassDef)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module is not None and is_ours(node.module):
            names |= {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
    return names


def _members(body: list[ast.stmt], names: Names, *, inside: bool) -> Iterator[Member]:
    for node, after in pairwise([*body, ast.Pass()]):
        if isinstance(node, Function) and not node.name.startswith("_"):
            yield from _function(node, names, inside=inside)
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield _class(node, names)
        elif isinstance(node, ast.Assign | ast.AnnAssign) and (said := _said(after)):
            target = node.target if isinstance(node, ast.AnnAssign) else node.targets[0]
            if isinstance(target, ast.Name) and not target.id.startswith("_"):
                kind: Kind = "attribute" if inside else "data"
                yield Member(kind=kind, name=target.id, options=tuple(_options(node, names)), docstring=said)


def _function(node: Function, names: Names, *, inside: bool) -> Iterator[Member]:
    marks = [ast.unparse(one) for one in node.decorator_list]
    if "overload" in marks or any(mark.endswith(".setter") for mark in marks):
        return
    docstring = ast.get_docstring(node) or ""
    returned = None if node.returns is None else annotation(node.returns, names)
    if any(mark.split(".")[-1] in _PROPERTIES for mark in marks):
        kind_of = () if returned is None else (f":type: {returned}",)
        yield Member(kind="property", name=node.name, options=kind_of, docstring=docstring)
        return
    options = tuple(f":{mark}:" for mark in marks if mark in ("classmethod", "staticmethod"))
    behind = "" if returned is None else f" -> {returned}"
    signature = arguments(node, names, bound=inside and "staticmethod" not in marks) + behind
    kind: Kind = "method" if inside else "function"
    yield Member(kind=kind, name=node.name, signature=signature, options=options, docstring=docstring)


def _class(node: ast.ClassDef, names: Names) -> Member:
    signature, marks = "", [ast.unparse(one) for one in (*node.decorator_list, *node.bases)]
    init = next((one for one in node.body if isinstance(one, ast.FunctionDef) and one.name == "__init__"), None)
    if init is not None:
        signature = arguments(init, names, bound=True)
    elif any("dataclass" in mark or mark == "NamedTuple" for mark in marks):
        signature = fields(node, names)
    return Member(
        kind="exception" if node.name.endswith("Error") else "class",
        name=node.name,
        signature=signature,
        docstring=ast.get_docstring(node) or "",
        members=tuple(_members(node.body, names, inside=True)),
    )


def _options(node: ast.Assign | ast.AnnAssign, names: Names) -> Iterator[str]:
    if isinstance(node, ast.AnnAssign) and (kind := annotation(node.annotation, names)) != "Final":
        yield f":type: {kind.removeprefix('Final[').removesuffix(']') if kind.startswith('Final[') else kind}"
    value = "" if node.value is None else ast.unparse(node.value)
    if 0 < len(value) < 60 and "\n" not in value:
        yield f":value: {value}"


def _said(node: ast.stmt) -> str:
    """Return the docstring after a constant; "" if another statement follows."""
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
        return "\n".join(line.strip() for line in node.value.value.strip().splitlines())
    return ""
