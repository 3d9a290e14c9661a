"""The page of error messages quotes the sources."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from stillwake.console.start import ROOMS

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "reference" / "errors.md").read_text(encoding="utf-8")
QUOTED = re.findall(r"^- `([^`]+)`: ", PAGE, flags=re.MULTILINE)
GAP = "\0"
"""Stands for what a message fills in."""


def _templates(tree: ast.AST) -> Iterator[str]:
    """Every text of a module but its docstrings, with a gap for each value in it."""
    alone = set[ast.expr]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr):
            alone.add(node.value)  # which comes later
        elif node in alone:
            continue
        elif isinstance(node, ast.JoinedStr):
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else GAP for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def _pattern(quoted: str) -> str:
    """Matches the line of a text; a gap of the page covers values and words between."""
    return ".*".join(re.escape(part) for part in re.split(r"\.\.\.+", quoted))


def test_every_message_is_in_the_sources():
    files = [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]
    found = {text.replace("\n", " ") for path in files for text in _templates(ast.parse(path.read_text("utf-8")))}
    texts = "\n".join(sorted(found))
    assert len(QUOTED) > 30 and len(set(QUOTED)) == len(QUOTED)
    assert [quoted for quoted in QUOTED if not re.search(_pattern(quoted), texts)] == []
    # A message that was reworded is found.
    assert not re.search(_pattern("bundle ...: not signed, must be signed by ..."), texts)
