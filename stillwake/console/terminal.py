"""What every command shares: the console, the progress bar with its estimate, and the options for settings."""

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Column, Table
from rich.text import Text

from stillwake.console.progress import ProgressBar, ProgressLines

WIDE: Final = 10_000
"""Columns where there is no terminal: a file, a pipe or a log has no right edge, and paths and hashes stay whole."""


def make_console(*, stderr: bool = False) -> Console:
    """A console that prints text as it is: brackets in a path are no markup, a control character is no command."""
    stream = sys.stderr if stderr else sys.stdout
    has_edge = (stream is not None and stream.isatty()) or "COLUMNS" in os.environ
    width = None if has_edge else WIDE
    return PlainConsole(stderr=stderr, markup=False, emoji=False, highlight=False, width=width)


class PlainConsole(Console):
    """Shows control characters in text as Python writes them; whoever wants colour gives `style` or a `Text`."""

    def print(self, *objects: Any, **options: Any) -> None:
        """As rich's, but lines of text are not broken: paths and commands stay whole."""
        super().print(*objects, **{"soft_wrap": all(isinstance(one, str | Text) for one in objects), **options})

    def render_str(self, text: str, **options: Any) -> Text:
        """As rich's."""
        return super().render_str(visible(text), **options)


def visible(text: str) -> str:
    """The text with its control characters and halves of surrogate pairs written out, but for line ends and tabs."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text)


console = make_console()

ConfigFile = Annotated[
    Path | None, typer.Option("--config", help="TOML file of settings, on top of the release's.", metavar="FILE")
]
JsonFile = Annotated[
    Path | None, typer.Option("--json", help="Also write the figures and their settings here.", metavar="FILE")
]
Threads = Annotated[
    int, typer.Option("--threads", help="Threads of torch. More are slower while other work runs.", min=1)
]
Overrides = Annotated[
    list[str],
    typer.Option(
        "--set",
        help="One setting, section.key=value (repeatable); `stillwake config` lists them.",
        metavar="KEY=VALUE",
    ),
]


def progress_bar(
    unit: str,
    *,
    estimate_over: float = 30.0,
    console: Console = console,
    clock: Callable[[], float] = time.monotonic,
) -> Progress:
    """Tasks with a bar, a count in `unit`, the time left, and the field `note`; where no terminal is, lines of text.

    Nothing is shown before the first update, so that an error at the start stands alone.

    Args:
        unit: of the counts, in the plural; a task whose field `unit` is another has that one.
        estimate_over: seconds, the latest ones, whose speed gives the time left.
        console, clock: where it is shown, and seconds.
    """
    kind = ProgressBar if console.is_interactive else ProgressLines
    return kind(unit, console=console, estimate_over=estimate_over, clock=clock)


@contextmanager
def phases_bar(name: str, phases: Sequence[str]) -> Iterator[tuple[Progress, Callable[[str], None]]]:
    """A bar over phases with names, and what is to be called as each of them begins."""
    with progress_bar("phases") as bar:
        task = bar.add_task(name, total=len(phases), note="")
        yield bar, lambda begun: bar.update(task, completed=phases.index(begun), note=begun)
        bar.update(task, completed=len(phases), note="")


def print_table(*heads: str | Column, rows: Iterable[Iterable[str | Text]], **options: Any) -> None:
    """Print rows of text under their heads; the options are those of rich's `Table`."""
    table = Table(*heads, **options)
    for row in rows:
        table.add_row(*row)
    console.print(table)
