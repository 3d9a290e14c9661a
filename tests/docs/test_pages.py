"""The documents name what exists: links and anchors, files, commands and their options, error messages; and their
pictures are of the results and the release that are there."""

import ast
import hashlib
import json
import re
import shlex
import tomllib
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import typer
from PIL import Image

import benchmarks.__main__ as door
import stillwake.__main__ as command_line
from benchmarks.common.documents import SOURCE, source_text
from contract.config.loading import load_config
from contract.config.tree import Config
from contract.release import bundle
from contract.shipped import BUNDLE
from docs.made import whole
from firmware_sim.bench.disturbances import Disturbances
from stillwake.console.start import ROOMS
from tests.conftest import kept_command

ROOT = Path(__file__).resolve().parents[2]
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
NOW = [page for page in PAGES if page.name != "CHANGELOG.md"]
"""Pages on the present state: the changelog names what was there at the time."""

_LINK = re.compile(r"\]\(([^)\s]+)\)")
_CODE = re.compile(r"```.*?```", re.DOTALL)
_FILE = re.compile(r"`([\w.-]+(?:/[\w.*-]+)*/(?:[\w*-]+\.(?:py|c|h|md|toml|pub|h5|npz|dbc|json))?)`")
_NAME = re.compile(r"`((?:contract|wake|export|can_bridge|firmware_sim|stillwake|benchmarks)(?:\.(?!npz\b)\w+)+)`")
_OWN = {path.parent.name for path in ROOT.glob("*/__init__.py")} | {"docs", "results", "tests"}
GAP = "\0"  # stands for what a message fills in
PICTURES = ROOT / "docs" / "pictures"
NOT_FROM_RESULTS = {"mean_flow.png"}  # drawn by `stillwake picture --field mean`


def _id(page: Path) -> str:
    return str(page.relative_to(ROOT))


@cache
def _text(page: Path) -> str:
    """A page as the site has it, with what is made in its places."""
    return whole(page.read_text(encoding="utf-8"))


@cache
def _anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    heads = re.findall(r"^#+ (.+)$", _CODE.sub("", _text(page)), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in heads}


def _commands(page: Path) -> Iterator[list[str]]:
    """Command lines in indented blocks and in running text, one list of words each, without comments."""
    text = _text(page).replace("\\\n", " ")
    blocks = re.findall(r"^    ((?:stillwake|python -m benchmarks|make)\b.*)$", text, re.MULTILINE)
    inline = re.findall(r"`((?:stillwake|python\s-m\sbenchmarks|make)\s[^`]+)`", text)
    for line in (*blocks, *inline):
        for one in line.split(" && "):
            yield shlex.split(one, comments=True)


def test_links_resolve():
    for page in PAGES:
        for link in _LINK.findall(_CODE.sub("", _text(page))):
            if "://" in link:
                continue
            path, _, anchor = link.partition("#")
            target = (page.parent / path).resolve() if path else page
            assert target.exists(), f"{_id(page)}: no file {link}"
            assert not anchor or anchor in _anchors(target), f"{_id(page)}: no heading {link}"


def test_named_files_exist():
    for page in NOW:
        for name in _FILE.findall(_text(page)):
            if name.split("/")[0] in _OWN and "NAME" not in name:
                assert list(ROOT.glob(name)), f"{_id(page)}: no {name}"


def test_named_modules_and_what_they_define_exist():
    for page in NOW:
        for name in _NAME.findall(_text(page)):
            path, parts = ROOT, name.split(".")
            while parts and (path / parts[0]).is_dir():
                path /= parts.pop(0)
            if parts and (path / f"{parts[0]}.py").is_file():
                text = (path / f"{parts.pop(0)}.py").read_text(encoding="utf-8")
                parts = [part for part in parts[:1] if not re.search(rf"^(?:class |def )?{part}\b", text, re.MULTILINE)]
            assert not parts, f"{_id(page)}: no {name}"


@pytest.mark.slow  # builds every command
def test_named_commands_exist():
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    for page in NOW:
        for words in _commands(page):
            if words[0] == "make":
                # A word with = sets a variable.
                assert {word for word in words[1:] if "=" not in word} <= targets, f"{_id(page)}: {shlex.join(words)}"
                continue
            options, rest = _found(words)
            known = options | {"--help"}
            given = {word for word in rest if word.startswith("--")}
            assert given <= known, f"{_id(page)}: {shlex.join(words)}: no option {given - known}"
            texts = [word for before, word in pairwise(rest) if before == "--set" and "METHOD" not in word]
            load_config(None, [word for word in texts if "=" in word])


def test_the_installs_carry_what_the_project_declares():
    rows = (ROOT / "docs" / "reference" / "installs.md").read_text(encoding="utf-8").splitlines()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = {f"`.[{extra}]`": names for extra, names in project["optional-dependencies"].items()}
    for install, requirements in {"`.`": project["dependencies"], **extras}.items():
        (row,) = (row for row in rows if row.startswith(f"| {install} |"))
        packages = {re.split(r"[^\w-]", requirement)[0] for requirement in requirements} - {"stillwake"}
        assert not {package for package in packages if package not in row}, f"{install}: the row lacks a package"


def test_every_page_is_in_the_index():
    index = ROOT / "docs" / "README.md"
    linked = {(index.parent / link.partition("#")[0]).resolve() for link in _LINK.findall(_text(index))}
    assert linked >= {page for page in PAGES if page.is_relative_to(index.parent) and page != index}


@cache
def _measurement(name: str) -> Any:
    """The command of `python -m benchmarks NAME`."""
    module = import_module(f"benchmarks.{(door.MEASUREMENTS | door.PAGES)[name].module}")
    app = typer.Typer()
    app.command()(module.main)
    return typer.main.get_command(app)


def _found(words: list[str]) -> tuple[set[str], list[str]]:
    """The options of the command that a line names, and the words after its name."""
    if words[0] == "python":
        name, *rest = words[3:] or ["--help"]
        if name in ("--help", "NAME"):
            return set(), rest
        assert name in door.MEASUREMENTS | door.PAGES, f"{shlex.join(words)}: no measurement {name}"
        command = _measurement(name)
    else:
        command, rest = kept_command(command_line.app), words[1:]
    while groups := getattr(command, "commands", None):
        if not (rest and rest[0] in groups) and (default := getattr(command, "default_command", None)):
            rest = [default, *rest]
        assert rest and rest[0] in groups, f"{shlex.join(words)}: one of {', '.join(groups)}"
        command, rest = groups[rest[0]], rest[1:]
    return {name for parameter in command.params for name in parameter.opts}, rest


def test_disturbances_in_examples_can_be_put_into_a_run():
    texts = {text for page in NOW for text in re.findall(r"--disturb ([^\s`]+=[^\s`]+)", _text(page))}
    assert len(texts) > 8
    for text in texts:
        Disturbances.parse([text]).check(Config(), ("upper_39", "lower_39", "base_0", "base_9"), duration_s=12.5)


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
    texts, page = "\n".join(sorted(found)), (ROOT / "docs" / "reference" / "errors.md").read_text(encoding="utf-8")
    shown = re.findall(r"^- `([^`]+)`: ", page, flags=re.MULTILINE)
    assert len(shown) > 30 and len(set(shown)) == len(shown)
    assert [quoted for quoted in shown if not re.search(_pattern(quoted), texts)] == []
    # A message that was reworded is found.
    assert not re.search(_pattern("bundle ...: not signed, must be signed by ..."), texts)


def test_pictures_from_results_name_the_present_file():
    for path in PICTURES.glob("*.png"):
        if path.name not in NOT_FROM_RESULTS:
            with Image.open(path) as image:
                stated = image.info[SOURCE]
            place = ROOT / stated.partition(" ")[0]
            assert source_text(place) == stated, f"{path.name} is stale: `python -m benchmarks pictures`"


def test_pictures_of_the_closed_loop_are_of_the_shipped_bundle():
    provenance = json.loads((PICTURES / "provenance.json").read_text(encoding="utf-8"))
    assert provenance["bundle"] == bundle.load(BUNDLE).digest, "another release is shipped: `make pictures`"
    names = ("closed_loop", "run_page", "compare_page", "live_page", "live_page_light", "live_page_phone")
    for name in ("docs/demo.png", *(f"docs/pictures/{name}.webp" for name in names)):
        digest = hashlib.sha256((ROOT / name).read_bytes()).hexdigest()
        assert provenance["files"][name] == digest, f"{name} was altered: `make pictures`"
    with Image.open(ROOT / "docs" / "demo.png") as image:
        assert image.info["Description"] == f"stillwake bundle {provenance['bundle']}"
