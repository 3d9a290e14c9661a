"""The live table on a terminal: drawn with rich, keys read from stdin."""

import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from can_bridge.tools.monitor import KEYS_HELP, TYPING_HELP, MonitorState, Row, View, rows, split_keys

HEAD_LINES = 7
"""Of the screen, that are not rows: heading, column names and their rule, keys, margins."""

STALE_S = 1.0
"""Age from which on a row is dim."""


def screen(
    state: MonitorState, view: View, now_ns: int, *, source: str, height: int | None = None, keys: bool = False
) -> RenderableType:
    """What is shown.

    Args:
        state, view: what was seen, and what of it.
        now_ns: in the clock of the frames.
        source: what the frames come from, in words.
        height: lines there are; None for all rows.
        keys: whether to name the keys.
    """
    found = rows(state, now_ns, matching=view.matching)
    shown = found if height is None else _window(found, view.top, max(1, height - HEAD_LINES))
    parts: list[RenderableType] = [_heading(state, view, source), _table(shown)]
    if keys:
        hidden = len(found) - len(shown)
        more = f"   {hidden} more rows" if hidden else ""
        parts.append(Text(TYPING_HELP if view.is_typing else KEYS_HELP + more, style="dim", no_wrap=True))
    return Group(*parts)


def line(state: MonitorState, seconds: float) -> str:
    """The same in a line, where no terminal is."""
    return (
        f"{seconds:.0f} s: {state.frames} data frames of {len(state.messages)} messages, {state.lost} lost, "
        f"{state.refused} refused by E2E, {state.others} remote or error frames"
    )


@contextmanager
def key_reader() -> Iterator[Callable[[], list[str]]]:
    """Yield what returns the keys pressed since it was last asked, without waiting; the terminal is put back after."""
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    try:
        # Ctrl-C stays a signal; nothing is echoed.
        tty.setcbreak(descriptor)

        def keys() -> list[str]:
            typed = b""
            while select.select([descriptor], [], [], 0.0)[0]:
                part = os.read(descriptor, 1024)
                if not part:
                    break
                typed += part
            return split_keys(typed.decode("utf-8", errors="ignore"))

        yield keys
    finally:
        with suppress(termios.error):
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def _window(found: list[Row], top: int, lines: int) -> list[Row]:
    begin = max(0, min(top, len(found) - lines))
    return found[begin : begin + lines]


def _heading(state: MonitorState, view: View, source: str) -> Text:
    text = Text(source, style="bold", no_wrap=True, overflow="ellipsis")
    text.append(f"   {state.frames} frames, {state.lost} lost, {state.refused} refused", style="not bold")
    if state.others:
        text.append(f", {state.others} remote or error", style="not bold")
    if view.is_paused:
        text.append("   paused", style="yellow")
    if view.matching or view.is_typing:
        text.append(f"   filter: {view.matching}{'_' if view.is_typing else ''}", style="cyan")
    return text


def _table(shown: list[Row]) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for name in ("message", "id", "signal"):
        table.add_column(name, no_wrap=True)
    table.add_column("value", justify="right", no_wrap=True, min_width=10, max_width=24)
    table.add_column("unit", no_wrap=True)
    for name in ("age, s", "rate, 1/s", "lost", "refused"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("E2E", no_wrap=True, min_width=14)
    for i, row in enumerate(shown):
        is_first = row.is_first or i == 0
        facts = (f"{row.age_s:.2f}", f"{row.rate_hz:.1f}") if is_first else ("", "")
        checks = (str(row.lost), str(row.refused), row.e2e) if is_first and row.e2e else ("", "", "")
        table.add_row(
            row.message if is_first else "",
            row.frame_id if is_first else "",
            Text(row.signal),
            Text(row.value),
            Text(row.unit),
            *facts,
            *checks[:2],
            Text(checks[2], style="" if row.is_good else "red"),
            style="dim" if row.age_s > STALE_S else "",
        )
    return table
