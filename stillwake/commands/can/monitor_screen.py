"""The table of `stillwake can monitor`, drawn by rich."""

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from can_bridge.tools.raw_bus import id_text
from can_bridge.tools.summary import Summary, rows

OTHER_COLUMNS = 70
"""Width in characters of all columns except the column of values, with the longest names and numbers."""

STALE_S = 1.0
"""Age in s of a message's newest frame above which the message's row is drawn dim."""


def screen(summary: Summary, now_s: float, *, source: str, matching: str, width: int) -> RenderableType:
    """Return the table with its heading.

    Args:
        now_s: present time in s, on the clock of the frames' time stamps.
        source: description of the bus or the log from which the frames come.
    """
    return Group(_heading(summary, matching, source), _table(summary, matching, round(now_s * 1e9), width))


def line(summary: Summary, seconds: float) -> str:
    """Return the summary in one line, for output without a terminal."""
    return (
        f"{seconds:.0f} s: {summary.frames} data frames of {len(summary.messages)} messages, {summary.lost} lost, "
        f"{summary.refused} refused, {_others(summary)} remote or error frames"
    )


def _others(summary: Summary) -> int:
    return summary.remote + summary.errors.total()


def _heading(summary: Summary, matching: str, source: str) -> Text:
    text = Text(no_wrap=True, overflow="ellipsis")
    text.append(f"{summary.frames} frames, {summary.lost} lost, {summary.refused} refused", style="bold")
    if _others(summary):
        text.append(f", {_others(summary)} remote or error", style="bold")
    if summary.unlisted:
        text.append(f", {summary.unlisted} with identifiers beyond the longest table", style="bold")
    if matching:
        text.append(f"   filter: {matching}", style="cyan")
    if summary.unchecked_macs:
        text.append(", MAC not checked", style="yellow")
    # The source is last, because a path may be longer than the line.
    text.append(f"   {source}")
    return text


def _table(summary: Summary, matching: str, now_ns: int, width: int) -> Table:
    """Return a table, at least 80 characters wide, with a row for each message and each signal."""
    value = min(24, max(10, width - OTHER_COLUMNS))
    table = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=0)
    table.add_column("message, signal", no_wrap=True, min_width=21)
    table.add_column("id, value", justify="right", no_wrap=True, min_width=10, max_width=value)
    table.add_column("unit", no_wrap=True, min_width=5)
    for name, width in (("age, s", 6), ("1/s", 6), ("lost", 4), ("refused", 7)):
        table.add_column(name, justify="right", no_wrap=True, min_width=width)
    table.add_column("E2E", no_wrap=True, min_width=14)
    several = len(summary.busy_ns) > 1
    for traffic, cells in rows(summary, matching=matching):
        age_s = traffic.age_ns(now_ns) / 1e9
        style = "dim" if age_s > STALE_S else ""
        table.add_row(
            Text(
                f"{traffic.channel} {traffic.name or 'unknown'}" if several else traffic.name or "unknown", style="bold"
            ),
            Text(id_text(traffic.latest), style="bold"),
            "",
            f"{age_s:.2f}",
            f"{traffic.rate_hz(now_ns):.1f}",
            *((str(traffic.lost), str(traffic.refused)) if traffic.verdict else ("", "")),
            Text(traffic.verdict, style="" if traffic.is_good else "red"),
            style=style,
        )
        for cell in cells:
            table.add_row(Text(f" {cell[0]}"), *map(Text, cell[1:]), style=style)
    return table
