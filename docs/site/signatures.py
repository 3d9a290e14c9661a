"""Signatures as in the source, but with the full names of the project's types, so that these types become links.

Python's evaluated types would be unreadable. An array would be `numpy.ndarray[tuple[...], numpy.dtype[...]]`.
"""

import ast
from collections.abc import Mapping
from copy import deepcopy

Function = ast.FunctionDef | ast.AsyncFunctionDef
Names = Mapping[str, str]
"""The full names of the project's types, by the names that a module uses for them."""


def arguments(node: Function, names: Names, *, bound: bool) -> str:
    """Return a function's arguments in brackets. If `bound` is true, the first argument is left out."""
    made = deepcopy(node.args)
    if bound:
        (made.posonlyargs or made.args).pop(0)
    for one in (*made.posonlyargs, *made.args, *made.kwonlyargs, made.vararg, made.kwarg):
        if one is not None and one.annotation is not None:
            one.annotation = ast.Name(id=annotation(one.annotation, names))
    return f"({ast.unparse(made)})"


def annotation(node: ast.expr, names: Names) -> str:
    """Return a type. The project's types begin with `~`, so that Sphinx shows only the last part of their names."""
    return ast.unparse(_Full(names).visit(deepcopy(node)))


def fields(node: ast.ClassDef, names: Names) -> str:
    """Return the fields of a dataclass or named tuple as arguments in brackets. A long default is shown as "..."."""
    found = ["*"] if any("kw_only=True" in ast.unparse(one) for one in node.decorator_list) else []
    for one in node.body:
        if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name) and not one.target.id.startswith("_"):
            kind = annotation(one.annotation, names)
            text = "" if one.value is None else ast.unparse(one.value)
            default = text if len(text) < 40 and not text.startswith("field(") else "..."
            if not kind.startswith("ClassVar"):
                found.append(f"{one.target.id}: {kind}" + (f" = {default}" if text else ""))
    return f"({', '.join(found)})"


class _Full(ast.NodeTransformer):
    """Replace the project's types by full names, `Annotated` by its type, and quoted types by types without quotes."""

    def __init__(self, names: Names) -> None:
        self.names = names

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return ast.Name(id=f"~{self.names[node.id]}") if node.id in self.names else node

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        text = node.value
        return self.visit_Name(ast.Name(id=text)) if isinstance(text, str) and text.isidentifier() else node

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        of = ast.unparse(node.value)
        if of == "Annotated" and isinstance(node.slice, ast.Tuple):
            return self.visit(node.slice.elts[0])  # type: ignore[no-any-return]
        return node if of == "Literal" else self.generic_visit(node)
