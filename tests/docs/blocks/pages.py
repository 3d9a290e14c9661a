"""Every block of code of every page with its language, its command lines, and what `plan.toml` does with each."""

import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

from markdown_it import MarkdownIt

ROOT: Final = Path(__file__).resolve().parents[3]
PLAN: Final[dict[str, Any]] = tomllib.loads(Path(__file__).with_name("plan.toml").read_text(encoding="utf-8"))
_PIPE: Final = re.compile(r"\s\|\s(?:less|head)\b.*$")


class Line(NamedTuple):
    """One command: its page, and its text on one line with single spaces and without comment."""

    page: str
    text: str

    @property
    def words(self) -> list[str]:
        """As a shell divides them, without a pipe into a pager or a file that takes the output."""
        return shlex.split(_PIPE.sub("", self.text).partition(" > ")[0])

    @property
    def goes_to(self) -> str:
        """The file that `>` names, or ""."""
        return self.text.partition(" > ")[2]

    @property
    def plan(self) -> dict[str, Any]:
        """Its entry of `plan.toml`; AssertionError if there is none."""
        entry: dict[str, Any] = next((one for one in PLAN["line"] if re.fullmatch(one["form"], self.text)), {})
        assert entry, f"{self.page}: write in tests/docs/blocks/plan.toml how this line runs: {self.text}"
        return entry

    @property
    def call(self) -> list[str]:
        whole = "\n".join(self.words)
        for item in self.plan.get("shorter", ()):
            for expression, replacement in PLAN["shorter"][item] if isinstance(item, str) else [item]:
                whole = re.sub(expression, replacement, whole)
        return [*filter(None, whole.split("\n")[1:]), *self.plan.get("added", "").split()]


class Block(NamedTuple):
    """One block: its page relative to the root of the checkout, the line of its first character, from 1, its language
    (shell, python, toml, c, ..., or "" for what is none by its first line), and its text without the indent."""

    page: str
    line: int
    language: str
    text: str

    @property
    def first(self) -> str:
        return self.text.partition("\n")[0]

    @property
    def kind(self) -> dict[str, Any]:
        """What a block without a language is; {} for one that has a language or is not listed."""
        found = (one for one in PLAN["block"] if self.first.strip().startswith(one["begin"]))
        return {} if self.language else next(found, {})

    @property
    def lines(self) -> list[Line]:
        bare = re.sub(r"(?m)(^|\s)#.*$", "", self.text.replace("\\\n", " "))
        texts = [" ".join(one.split()) for line in bare.split("\n") for one in re.split(r"\s&&\s", line)]
        return [Line(self.page, text) for text in texts if text and self.language == "shell"]


def blocks() -> list[Block]:
    """All blocks of the pages that speak of the present, in their order: of all but the changelog."""
    tops = [path for path in sorted(ROOT.glob("*.md")) if path.name != "CHANGELOG.md"]
    files = (*tops, *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "examples").glob("*/README.md")))
    return [block for path in files for block in _of(path)]


def python(page: str) -> list[str]:
    """The blocks of Python of one page of `docs/`."""
    return [block.text for block in _of(ROOT / "docs" / page) if block.language == "python"]


def _of(path: Path) -> Iterator[Block]:
    page = path.relative_to(ROOT).as_posix()
    for token in MarkdownIt().parse(path.read_text(encoding="utf-8")):
        first = 1 + (token.map or [0])[0]
        if token.type == "fence" and token.info:
            yield Block(page, first + 1, token.info.split()[0], token.content)
        elif token.type in ("fence", "code_block"):
            # In an indented block a command may follow what it reads, or come before what it prints.
            parts = list(re.finditer(r"(?:.+\n?)+", token.content))
            if "shell" not in {_guessed(part[0]) for part in parts}:
                yield Block(page, first, _guessed(token.content), token.content)
                continue
            for part in parts:
                before = token.content[: part.start()].count("\n")
                yield Block(page, first + before, _guessed(part[0]), part[0])


def _guessed(text: str) -> str:
    word = text.split(maxsplit=1)[0]
    return "shell" if word in PLAN["programs_of_a_shell"] else "python" if word in ("import", "from") else ""
