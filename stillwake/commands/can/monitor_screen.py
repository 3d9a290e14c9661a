"""The live table on a terminal: drawn with rich, keys read from stdin."""

import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from can_bridge.tools.monitor import KEYS_HELP, TYPING_HELP, MonitorState, Row, View, rows, split_keys

HEAD_LINES = 5
"""Lines of the screen that are not rows: heading, column names and their rule, keys, the cursor's."""

OTHER_COLUMNS = 70
"""Columns of the screen that are not the value: what the widest names and numbers take."""

STALE_S = 1.0
"""Age from which on a row is dim."""


def screen(
    state: MonitorState,
    view: View,
    now_ns: int,
    *,
    source: str,
    width: int,
    height: int | None = None,
    keys: bool = False,
) -> RenderableType:
    """What is shown.

    Args:
        state, view: what was seen, and what of it.
        now_ns: in the clock of the frames.
        source: what the frames come from, in words.
        width: columns there are.
        height: lines there are; None for all rows.
        keys: whether to name the keys.
    """
    found = rows(state, now_ns, matching=view.matching)
    shown = found if height is None else page(found, view.top, height - HEAD_LINES)
    parts: list[RenderableType] = [_heading(state, view, source), _table(shown, width)]
    if keys:
        hidden = len(found) - len(shown)
        more = f"   {hidden} more rows" if hidden else ""
        parts.append(Text(TYPING_HELP if view.is_typing else KEYS_HELP + more, style="dim", no_wrap=True))
    return Group(*parts)


def line(state: MonitorState, seconds: float) -> str:
    """The same in a line, where no terminal is."""
    return (
        f"{seconds:.0f} s: {state.frames} data frames of {len(state.messages)} messages, {state.lost} lost, "
        f"{state.refused} refused, {state.others} remote or error frames"
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


def page(found: list[Row], top: int, lines: int) -> list[Row]:
    """The rows that fit into so many lines, from `top` on, or the last ones: the first always names its message."""

    def from_row(begin: int) -> list[Row]:
        return [replace(one, is_first=one.is_first or i == 0) for i, one in enumerate(found[begin:])]

    def height(shown: list[Row]) -> int:
        return sum(1 + one.is_first for one in shown)

    begin = min(top, len(found))
    while begin > 0 and height(from_row(begin - 1)) <= lines:
        begin -= 1
    shown = from_row(begin)
    while len(shown) > 1 and height(shown) > lines:
        shown.pop()
    return shown


def _heading(state: MonitorState, view: View, source: str) -> Text:
    text = Text(no_wrap=True, overflow="ellipsis")
    text.append(f"{state.frames} frames, {state.lost} lost, {state.refused} refused", style="bold")
    if state.others:
        text.append(f", {state.others} remote or error", style="bold")
    if state.unlisted:
        text.append(f", {state.unlisted} of more identifiers than are listed", style="bold")
    if view.is_paused:
        text.append("   paused", style="yellow")
    if view.matching or view.is_typing:
        text.append(f"   filter: {view.matching}{'_' if view.is_typing else ''}", style="cyan")
    if state.has_unchecked_macs:
        text.append(", MAC not checked", style="yellow")
    # Last, because a path may be longer than the line.
    text.append(f"   {source}")
    return text


def _table(shown: list[Row], width: int) -> Table:
    """A line for each message with what is the message's, and one for each of its signals; fits into 80 columns."""
    value = min(24, max(10, width - OTHER_COLUMNS))
    table = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=0)
    table.add_column("message, signal", no_wrap=True, min_width=21)
    table.add_column("id, value", justify="right", no_wrap=True, min_width=10, max_width=value)
    table.add_column("unit", no_wrap=True, min_width=5)
    for name, width in (("age, s", 6), ("1/s", 6), ("lost", 4), ("refused", 7)):
        table.add_column(name, justify="right", no_wrap=True, min_width=width)
    table.add_column("E2E", no_wrap=True, min_width=14)
    for row in shown:
        is_old = row.age_s > STALE_S
        if row.is_first:
            checks = (str(row.lost), str(row.refused)) if row.e2e else ("", "")
            table.add_row(
                Text(row.message, style="bold"),
                Text(row.frame_id, style="bold"),
                "",
                f"{row.age_s:.2f}",
                f"{row.rate_hz:.1f}",
                *checks,
                Text(row.e2e, style="" if row.is_good else "red"),
                style="dim" if is_old else "",
            )
        table.add_row(Text(f" {row.signal}"), Text(row.value), Text(row.unit), style="dim" if is_old else "")
    return table
