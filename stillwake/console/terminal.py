"""The console: text as it is, and tables."""

import os
import sys
from collections.abc import Iterable
from typing import Any, Final

from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

_WIDE: Final = 10_000
"""Columns where there is no terminal: a file, a pipe or a log has no right edge, and paths and hashes stay whole."""


def make_console(*, stderr: bool = False) -> Console:
    """A console that prints text as it is: brackets in a path are no markup, a control character is no command."""
    stream = sys.stderr if stderr else sys.stdout
    has_edge = (stream is not None and stream.isatty()) or "COLUMNS" in os.environ
    width = None if has_edge else _WIDE
    return PlainConsole(stderr=stderr, markup=False, emoji=False, highlight=False, width=width)


class PlainConsole(Console):
    """Shows control characters in text as Python writes them; whoever wants colour gives `style` or a `Text`."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does, but lines of text are not broken: paths and commands stay whole."""
        super().print(*objects, **{"soft_wrap": all(isinstance(one, str | Text) for one in objects), **options})

    def render_str(self, text: str, **options: Any) -> Text:
        """Render as rich does."""
        return super().render_str(visible(text), **options)


def visible(text: str) -> str:
    """The text with its control characters and halves of surrogate pairs written out, but for line ends and tabs."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text)


console = make_console()


def print_table(*heads: str | Column, rows: Iterable[Iterable[str | Text]], **options: Any) -> None:
    """Print rows of text under their heads; the options are those of rich's `Table`."""
    table = Table(*heads, **options)
    for row in rows:
        table.add_row(*row)
    console.print(table)
