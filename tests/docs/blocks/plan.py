"""How a block or a line of a page is run: the kinds of treatment, and which one a line gets."""

import re
from dataclasses import dataclass
from typing import Final

from tests.docs.blocks.lines import Line


@dataclass(frozen=True, kw_only=True)
class Rule:
    """For lines of this form.

    Attributes:
        form: regular expression of the whole line (`Line.text`).
    """

    form: str

    def is_for(self, line: Line) -> bool:
        return re.fullmatch(self.form, line.text) is not None


@dataclass(frozen=True, kw_only=True)
class Run(Rule):
    """It runs.

    Attributes:
        shortened: (expression, replacement) pairs, where the line as it stands takes long.
        added: options behind the line, for the same reason.
        slow: left to `make full`; elsewhere its output is put in place by `instead`.
        instead: what stands for the line's output where it does not run: a name in `given.MAKERS`, and the word of
            the line that it lies at.
        replaced: that it stands there also where the line ran: what a whole training, or a whole drive, would leave.
        statuses: exit statuses that the page allows for.
    """

    shortened: tuple[tuple[str, str], ...] = ()
    added: str = ""
    slow: bool = False
    instead: tuple[str, int] | None = None
    replaced: bool = False
    statuses: tuple[int, ...] = (0,)

    def call(self, line: Line) -> list[str]:
        """The words that are run, without the program."""
        words = line.words
        whole = "\n".join(words)
        for expression, replacement in self.shortened:
            whole = re.sub(expression, replacement, whole)
        return [*filter(None, whole.split("\n")[1:]), *self.added.split()]


@dataclass(frozen=True, kw_only=True)
class Elsewhere(Rule):
    """Another test runs it.

    Attributes:
        test: its node: file::function.
    """

    test: str


@dataclass(frozen=True, kw_only=True)
class Cannot(Rule):
    """It does not run in a test.

    Attributes:
        why: in words.
    """

    why: str


MULTICAST: Final = r"239\.74\.163\.2"
