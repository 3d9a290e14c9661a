"""Every block of code of every page, with its language."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from markdown_it import MarkdownIt

ROOT: Final = Path(__file__).resolve().parents[3]

PROGRAMS: Final = (
    *("stillwake", "python", "make", "pip", "pytest", "cmake", "cc", "cd", ".", "sudo", "tail", "openssl"),
    *("cantools", "dask", "OMP_NUM_THREADS=1", "#!/bin/sh", "ssh"),
)
"""What a shell's block begins with. One that begins otherwise is none: see `fragments.py`."""

_FENCED: Final = {"bash": "shell", "sh": "shell", "console": "shell", "c++": "cpp"}


@dataclass(frozen=True, kw_only=True)
class Block:
    """One block.

    Attributes:
        page: its file, relative to the root of the checkout.
        line: of its first character, from 1.
        language: shell, python, toml, c, ..., or "" for what is none by its first line.
        text: without the indent, ended by a line break.
    """

    page: str
    line: int
    language: str
    text: str

    @property
    def first(self) -> str:
        """The first line, by which a block is named."""
        return self.text.partition("\n")[0]

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def files() -> list[Path]:
    """The pages that speak of the present: all but the changelog."""
    tops = [path for path in sorted(ROOT.glob("*.md")) if path.name != "CHANGELOG.md"]
    return [*tops, *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "examples").glob("*/README.md"))]


def blocks() -> list[Block]:
    """All blocks of all pages, in their order."""
    return [block for path in files() for block in _of(path)]


def _of(path: Path) -> Iterator[Block]:
    page = path.relative_to(ROOT).as_posix()
    for token in MarkdownIt().parse(path.read_text(encoding="utf-8")):
        if token.type not in ("fence", "code_block"):
            continue
        assert token.map is not None
        language = token.info.split(" ")[0] if token.info else ""
        first = token.map[0] + 1 + (token.type == "fence")
        if language:
            yield Block(page=page, line=first, language=_FENCED.get(language, language), text=token.content)
            continue
        # In an indented block a command may follow what it reads, or come before what it prints.
        for offset, part in _parts(token.content):
            yield Block(page=page, line=first + offset, language=_guessed(part), text=part)


def _parts(text: str) -> Iterator[tuple[int, str]]:
    """(lines before it, part) of a block, divided at empty lines where one of the parts is a shell's."""
    parts = [(text[: found.start()].count("\n"), found[0]) for found in re.finditer(r"(?:.+\n?)+", text)]
    if any(_guessed(part) == "shell" for _, part in parts):
        yield from parts
    else:
        yield 0, text


def _guessed(text: str) -> str:
    first = text.split(maxsplit=1)[0]
    if first in PROGRAMS:
        return "shell"
    if first in ("import", "from"):
        return "python"
    return ""
