"""The console, which prints texts unchanged, and tables."""

import os
import sys
from collections.abc import Iterable, Mapping
from typing import Any, Final

from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

_WIDE: Final = 10_000
"""Width in characters if there is no terminal: a file, a pipe or a log has no right edge at which to break lines."""


def make_console(*, stderr: bool = False) -> Console:
    """Return a console that prints text literally: brackets are not markup, and control characters are escaped."""
    stream = sys.stderr if stderr else sys.stdout
    has_edge = (stream is not None and stream.isatty()) or "COLUMNS" in os.environ
    width = None if has_edge else _WIDE
    return PlainConsole(stderr=stderr, markup=False, emoji=False, highlight=False, width=width)


class PlainConsole(Console):
    """A console that shows control characters as escapes. Only `style` or a `Text` gives colour."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does, but without breaking lines of text, so that paths and commands stay whole. On a narrow
        terminal a table's words and numbers are folded; rich would cut off their ends."""
        for column in (column for one in objects if isinstance(one, Table) for column in one.columns):
            column.overflow = "fold"
        super().print(*objects, **{"soft_wrap": all(isinstance(one, str | Text) for one in objects), **options})

    def render_str(self, text: str, **options: Any) -> Text:
        """Render a text as rich does, with its control characters made visible."""
        return super().render_str(visible(text), **options)


def visible(text: str) -> str:
    """Return the text with its control characters and lone surrogates escaped, except line ends and tabs."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text)


console = make_console()


def print_table(*heads: str | Column, rows: Iterable[Iterable[str | Text]], **options: Any) -> None:
    """Print rows of text below their headings; `options` are options of rich's `Table`."""
    table = Table(*heads, **options)
    for row in rows:
        table.add_row(*row)
    console.print(table)


def listed(counts: Mapping[str, int]) -> str:
    """Return names with their counts in one line, the largest count first; counts of 0 are left out."""
    return ", ".join(f"{name} {count}" for name, count in sorted(counts.items(), key=lambda one: -one[1]) if count)
