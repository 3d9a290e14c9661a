"""The house keeps its shape and its weight: no circles, short listings, ceilings of lines."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from docs.made import whole

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("contract", "wake", "train", "export", "can_bridge", "ecu", "firmware_sim", "stillwake")
MOST_MODULES = 15
"""In a folder: more is a listing that nobody reads."""
MOST_LINES = {"source": 64_400, "benchmarks": 4_810, "tests": 52_560}
"""Of Python; a ratchet, lowered with every line that goes."""

MOST_WORDS = 83_300
"""Of the documents, as wc counts them, with what is made in them."""


def _sources(*folders: str) -> list[Path]:
    return [path for folder in folders for path in (ROOT / folder).rglob("*.py")]


def _modules() -> dict[str, Path]:
    found = {}
    for path in _sources(*ROOMS, "benchmarks"):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        found[name.removesuffix(".__init__")] = path
    return found


def _imported(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (item.name for item in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{item.name}" for item in node.names)


def _arrows(modules: dict[str, Path]) -> set[tuple[str, str]]:
    """(importing module, imported module), imports inside functions and for types among them."""
    arrows = set()
    for name, path in modules.items():
        for target in _imported(path):
            while target and target not in modules:
                target = target.rpartition(".")[0]
            if target and target != name:
                arrows.add((name, target))
    return arrows


def _circle(arrows: set[tuple[str, str]]) -> set[str]:
    """What is in a circle, or between two: what is left when every end of a chain has been taken away."""
    left = set(arrows)
    while True:
        inner = {upper for upper, _ in left} & {lower for _, lower in left}
        kept = {(upper, lower) for upper, lower in left if upper in inner and lower in inner}
        if kept == left:
            return inner
        left = kept


@pytest.mark.slow  # reads every file
def test_neither_files_nor_folders_import_each_other_in_a_circle():
    modules = _modules()
    arrows = _arrows(modules)
    assert _circle(arrows) == set(), "files that import each other"

    def folder(name: str) -> str:
        return str(modules[name].parent.relative_to(ROOT))

    between = {(folder(upper), folder(lower)) for upper, lower in arrows if folder(upper) != folder(lower)}
    assert _circle(between) == set(), "folders that import each other"


def test_a_circle_is_seen():
    assert _circle({("a", "b"), ("b", "c")}) == set()
    assert _circle({("a", "b"), ("b", "c"), ("c", "b"), ("c", "d")}) == {"b", "c"}


def test_no_folder_is_a_long_list():
    listed: dict[Path, int] = {}
    for path in _sources(*ROOMS):
        if path.name != "__init__.py":
            listed[path.parent] = listed.get(path.parent, 0) + 1
    assert {str(path.relative_to(ROOT)): count for path, count in listed.items() if count > MOST_MODULES} == {}


def test_nothing_grows_over_its_ceiling():
    weights = {"source": _sources(*ROOMS), "benchmarks": _sources("benchmarks"), "tests": _sources("tests")}
    for name, paths in weights.items():
        lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)
        assert lines <= MOST_LINES[name], f"{name}: {lines} lines of Python, {MOST_LINES[name]} are allowed"
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    words = sum(len(whole(page.read_text(encoding="utf-8")).split()) for page in pages)
    assert words <= MOST_WORDS, f"docs: {words} words, {MOST_WORDS} are allowed"
