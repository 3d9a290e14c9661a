"""The page of error messages quotes the sources."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

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


@pytest.fixture(scope="module")
def texts() -> str:
    """All texts of the packages, a line each."""
    files = [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]
    found = {text.replace("\n", " ") for path in files for text in _templates(ast.parse(path.read_text("utf-8")))}
    return "\n".join(sorted(found))


def _pattern(quoted: str) -> str:
    """Matches a line of `texts`; a gap of the page covers values and words between."""
    return ".*".join(re.escape(part) for part in re.split(r"\.\.\.+", quoted))


def test_every_message_is_in_the_sources(texts):
    assert len(QUOTED) > 30 and len(set(QUOTED)) == len(QUOTED)
    absent = [quoted for quoted in QUOTED if not re.search(_pattern(quoted), texts)]
    assert not absent


def test_a_message_that_was_reworded_is_found(texts):
    quoted = "bundle ...: unsigned, must be signed by ..."
    assert re.search(_pattern(quoted), texts)
    assert not re.search(_pattern(quoted.replace("unsigned", "not signed")), texts)
