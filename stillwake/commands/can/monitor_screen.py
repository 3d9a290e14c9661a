"""The table of `stillwake can monitor`, as rich draws it."""

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from can_bridge.tools.monitor import MonitorState, Row, rows

OTHER_COLUMNS = 70
"""Columns of the screen that are not the value: what the widest names and numbers take."""

STALE_S = 1.0
"""Age from which on a row is dim."""


def screen(state: MonitorState, now_ns: int, *, source: str, matching: str, width: int) -> RenderableType:
    """What is shown.

    Args:
        now_ns: in the clock of the frames.
        source: what the frames come from, in words.
    """
    return Group(_heading(state, matching, source), _table(rows(state, now_ns, matching=matching), width))


def line(state: MonitorState, seconds: float) -> str:
    """The same in a line, where no terminal is."""
    return (
        f"{seconds:.0f} s: {state.frames} data frames of {len(state.messages)} messages, {state.lost} lost, "
        f"{state.refused} refused, {state.others} remote or error frames"
    )


def _heading(state: MonitorState, matching: str, source: str) -> Text:
    text = Text(no_wrap=True, overflow="ellipsis")
    text.append(f"{state.frames} frames, {state.lost} lost, {state.refused} refused", style="bold")
    if state.others:
        text.append(f", {state.others} remote or error", style="bold")
    if state.unlisted:
        text.append(f", {state.unlisted} of more identifiers than are listed", style="bold")
    if matching:
        text.append(f"   filter: {matching}", style="cyan")
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
