"""The house keeps its shape and its weight: no circles in any language, short listings, ceilings of lines, and
texts beside the code that stand by themselves: none begins with a preposition that leans on a name."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from docs.made import whole
from docs.rooms import import_statements

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("contract", "wake", "train", "export", "can_bridge", "ecu", "firmware_sim", "stillwake")
MOST_MODULES = 15
"""In a folder: more is a listing that nobody reads."""
MOST_C_MODULES = 25
"""In a folder: the ECU's has as many, by the names of its twin's modules."""
MOST_LINES = {
    "source": 55_727, "benchmarks": 3_999, "tests": 48_668, "own C": 15_700, "JavaScript": 2_774, "docs": 1_991,
    "examples": 1_920,
}  # fmt: skip
"""Of Python, but for C and JavaScript without the code of others; a ratchet, lowered with every line that goes."""
MOST_WORDS = 63_979
"""Of the documents, as wc counts them, with what is made in them."""
STAND_TWICE = {
    "an option, by its word, beside the class or type of what it gives": """Board Bundle Bus Drive Freshness Key
        PlantName Settings State StageTimes""",
    "an option, by its word, beside another thing of a room": "NoAverages Periods Priority Store",
    "options of one word in several commands, with help and default of each": "DataSet Duration EcuName",
    "the settings that a command reads, at the top of its file": "USES",
    "a TypeVar, which says nothing": "S T",
}
"""Public names in several files by the reason for which they stay; every other one says which it is."""
_PUBLIC = re.compile(r"^(?:class (?=[A-Z])|(?=[A-Z]\w*(?:: [^=\n]+)? = ))(\w+)", re.MULTILINE)
"""A class or constant at the top of a file that others may use."""
_WORDS = r"(?:As|After|At|By|For|From|In|Of|On|To|With|Until)\b.*"
_DOCSTRING = re.compile(rf'^\s*r?"""\s*{_WORDS}', re.MULTILINE)
"""The beginning of a docstring of a module, class, function, constant or field."""
_C_COMMENT = re.compile(rf"^/\*+\s*{_WORDS}", re.MULTILINE)
"""The beginning of a comment that opens a file, or a function, in C."""
_INCLUDED = re.compile(r'^#include "(\w+\.h)"', re.MULTILINE)


def sources(*folders: str) -> list[Path]:
    """Python of these folders, without the copies of the gallery's scripts that the site makes."""
    found = (path for folder in folders for path in (ROOT / folder).rglob("*.py"))
    return [path for path in found if "generated" not in path.parts]


def others(*suffixes: str) -> list[Path]:
    """Files of other languages, without the code of others."""
    found = (path for folder in (*ROOMS, "examples", "docs") for path in (ROOT / folder).rglob("*"))
    return [path for path in found if path.suffix in suffixes and "vendor" not in path.parts]


def _modules() -> dict[str, Path]:
    found = {}
    for path in sources(*ROOMS, "benchmarks"):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        found[name.removesuffix(".__init__")] = path
    return found


def _imported(path: Path) -> Iterator[str]:
    for node in import_statements(path.read_text(encoding="utf-8")):
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


def _c_arrows() -> set[tuple[Path, Path]]:
    """(including module, included module) in C, where a module is its `.c` with its `.h`. A header that several folders
    have is each of them, but for one next to the file; one that is generated is none."""
    sources = others(".c", ".h")
    arrows = set()
    for path in sources:
        for name in _INCLUDED.findall(path.read_text(encoding="utf-8")):
            found = [other for other in sources if other.name == name]
            beside = [other for other in found if other.parent == path.parent]
            arrows |= {(path.with_suffix(""), other.with_suffix("")) for other in beside or found}
    return {(upper, lower) for upper, lower in arrows if upper != lower}


def _circle(arrows: set[tuple[Any, Any]]) -> set[Any]:
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


def test_neither_sources_nor_folders_of_c_include_each_other_in_a_circle():
    arrows = _c_arrows()
    assert len(arrows) > 100
    assert _circle(arrows) == set(), "sources that include each other"
    folders = {(upper.parent, lower.parent) for upper, lower in arrows if upper.parent != lower.parent}
    assert _circle(folders) == set(), "folders that include each other"


def test_a_circle_is_seen():
    assert _circle({("a", "b"), ("b", "c")}) == set()
    assert _circle({("a", "b"), ("b", "c"), ("c", "b"), ("c", "d")}) == {"b", "c"}


def test_no_folder_is_a_long_list():
    listed: dict[Path, int] = {}
    for path in sources(*ROOMS):
        if path.name != "__init__.py":
            listed[path.parent] = listed.get(path.parent, 0) + 1
    assert {str(path.relative_to(ROOT)): count for path, count in listed.items() if count > MOST_MODULES} == {}
    modules: dict[Path, set[str]] = {}
    for path in others(".c", ".h"):
        modules.setdefault(path.parent, set()).add(path.stem)
    assert {str(path): len(found) for path, found in modules.items() if len(found) > MOST_C_MODULES} == {}


def test_no_public_name_stands_twice():
    files: dict[str, set[Path]] = {}
    for path in sources(*ROOMS):
        for name in _PUBLIC.findall(re.sub('"""(?s:.)*?"""', "", path.read_text(encoding="utf-8"))):
            files.setdefault(name, set()).add(path)
    twice = {name: sorted(map(str, found)) for name, found in files.items() if len(found) > 1}
    listed = " ".join(STAND_TWICE.values()).split()
    assert len(listed) <= 20, "give it another name"
    assert {name: found for name, found in twice.items() if name not in listed} == {}, "say in the name which it is"
    assert [name for name in listed if name not in twice] == [], "stands in one file: take it off the list"


def test_nothing_grows_over_its_ceiling():
    weights = {"source": sources(*ROOMS), "own C": others(".c", ".h"), "JavaScript": others(".js")}
    weights |= {name: sources(name) for name in ("benchmarks", "tests", "docs", "examples")}
    for name, paths in weights.items():
        lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)
        assert lines <= MOST_LINES[name], f"{name}: {lines} lines, {MOST_LINES[name]} are allowed"
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    words = sum(len(whole(page.read_text(encoding="utf-8")).split()) for page in pages)
    assert words <= MOST_WORDS, f"docs: {words} words, {MOST_WORDS} are allowed"


def test_the_python_that_the_text_beside_c_names_exists():
    named = {
        (path.name, name)
        for path in [*others(".c", ".h"), *ROOT.glob("ecu/c/**/*.md")]
        for name in re.findall(r"\w+(?:/\w+)+\.py\b", path.read_text(encoding="utf-8"))
    }
    assert len(named) > 10
    assert [one for one in sorted(named) if not (ROOT / one[1]).exists()] == []


def test_no_docstring_and_no_c_comment_begins_with_a_preposition():
    for paths, pattern in ((sources(*ROOMS, "benchmarks"), _DOCSTRING), (others(".c", ".h"), _C_COMMENT)):
        texts = {str(path): path.read_text(encoding="utf-8") for path in paths}
        assert sum('"""' in text or "/*" in text for text in texts.values()) > 50
        assert {name: found for name, text in texts.items() if (found := pattern.findall(text))} == {}


def test_a_fragment_is_seen():
    seen = 'ROOM: Final = 2\n"""In frames."""\n\ndef kept(self):\n    """\n    Until a reset."""\n'
    assert len(_DOCSTRING.findall(seen)) == 2
    assert _DOCSTRING.findall('x = """"In"""\n"""Inches, a room of frames."""\n') == []
    assert _C_COMMENT.findall("/* For one frame. */\nint sw_sent(void) { /* To the bus. */") == ["/* For one frame. */"]
