"""The command lines of the pages, and what `plan.toml` does with each."""

import re
import shlex
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from tests.docs.blocks.pages import Block

PLAN: Final[dict[str, Any]] = tomllib.loads(Path(__file__).with_name("plan.toml").read_text(encoding="utf-8"))
_PIPE: Final = re.compile(r"\s\|\s(?:less|head)\b.*$")


@dataclass(frozen=True, kw_only=True)
class Line:
    """One command: its page, and its text on one line with single spaces and without comment."""

    page: str
    text: str

    @property
    def words(self) -> list[str]:
        """As a shell divides them, without a pipe into a pager or a file that takes the output."""
        words = shlex.split(_PIPE.sub("", self.text))
        return words[: words.index(">")] if ">" in words else words

    @property
    def goes_to(self) -> str | None:
        """The file that `>` names."""
        words = shlex.split(self.text)
        return words[words.index(">") + 1] if ">" in words else None

    @property
    def plan(self) -> dict[str, Any]:
        """Its entry of `plan.toml`; AssertionError if there is none."""
        return _plan(self.page, self.text)

    @property
    def call(self) -> list[str]:
        """The words that are run, without the program."""
        whole = "\n".join(self.words)
        for item in self.plan.get("shorter", ()):
            for expression, replacement in PLAN["shorter"][item] if isinstance(item, str) else [item]:
                whole = re.sub(expression, replacement, whole)
        return [*filter(None, whole.split("\n")[1:]), *self.plan.get("added", "").split()]


@cache
def _plan(page: str, text: str) -> dict[str, Any]:
    entry: dict[str, Any] | None = next((one for one in PLAN["line"] if re.fullmatch(one["form"], text)), None)
    assert entry is not None, f"{page}: write in tests/docs/blocks/plan.toml how this line runs: {text}"
    return entry


def lines(block: Block) -> list[Line]:
    """The commands of a block of a shell, in their order."""
    if block.language != "shell":
        return []
    bare = [re.sub(r"(^|\s)#.*$", "", line) for line in block.text.replace("\\\n", " ").splitlines()]
    texts = [re.sub(r"\s+", " ", one).strip() for line in bare for one in re.split(r"\s&&\s", line)]
    return [Line(page=block.page, text=text) for text in texts if text]


def kind(block: Block) -> dict[str, Any]:
    """What a block without a language is; {} for one that has a language or is not listed."""
    if block.language:
        return {}
    return next((one for one in PLAN["block"] if block.first.strip().startswith(one["begin"])), {})
