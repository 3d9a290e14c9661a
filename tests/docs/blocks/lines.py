"""The command lines of a shell's block, one by one."""

import re
import shlex
from dataclasses import dataclass
from typing import Final

from tests.docs.blocks.pages import Block

_PIPE: Final = re.compile(r"\s\|\s(?:less|head)\b.*$")


@dataclass(frozen=True, kw_only=True)
class Line:
    """One command.

    Attributes:
        page: where it stands.
        text: on one line, single spaces, without comment: what the plan knows it by.
    """

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


def lines(block: Block) -> list[Line]:
    """The commands of a block, in their order."""
    whole = block.text.replace("\\\n", " ")
    found = []
    for written in whole.splitlines():
        bare = re.sub(r"(^|\s)#.*$", "", written)
        for one in re.split(r"\s&&\s", bare):
            text = re.sub(r"\s+", " ", one).strip()
            if text:
                found.append(Line(page=block.page, text=text))
    return found
