"""The command `stillwake can monitor`, which shows a live table of a bus, or the table of a log."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from contract.errors import BusError, ConfigError
from stillwake.commands.can.frames import BUS, Channel, key_of
from stillwake.console import options as shared
from stillwake.console.progress import progress
from stillwake.console.settings import DIAGNOSIS, settings, with_bus
from stillwake.console.stopping import until_stopped
from stillwake.console.terminal import console

if TYPE_CHECKING:
    from can_bridge.bus.backends.connection import RawBus
    from can_bridge.tools.traffic import Summary

REFRESH_S = 0.1
"""Time between two drawings of the table, in s."""
MOST_AT_ONCE = 2000
"""Largest number of frames read between two drawings, so that the table is also redrawn on a flooded bus."""
STALE_S = 1.0
"""Age in s of a message's newest frame above which the message's row is drawn dim."""

Duration = Annotated[float | None, typer.Option("--for", help="End after this number of seconds.", metavar="SECONDS")]


def monitor(
    log: Annotated[Path | None, typer.Argument(help="Log to read instead of a bus; shows its last state.")] = None,
    channel: Channel = None,
    seconds: Duration = None,
    match: Annotated[str, typer.Option("--filter", help="Show rows with these words in message, id or signal.")] = "",
    bus: shared.Bus = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Show every signal on a bus with value, unit, age, rate, losses and end-to-end check.

    Ctrl-C ends the command and prints the whole table. Until then the table is cut off at the end of the screen;
    --filter shows fewer rows. Without a terminal the command prints one line per second, and the table at the end.

    The column "lost" counts the frames that are missing according to the counters. The column "refused" counts the
    frames that a receiver would not have used. The column "E2E" shows the result of the newest frame's check. With
    --set bus.key=FILE the MAC and freshness of secured messages are checked first. Messages of other systems are shown
    as bytes; `cantools monitor` decodes these messages.
    """
    from can_bridge.tools.traffic import MOST_MESSAGES, Summary

    uses = (*(BUS if log is None else ()), "bus.e2e", "bus.key", DIAGNOSIS)
    config = settings("can monitor", with_bus(bus, given), uses=uses).config.bus
    if seconds is not None:
        shared.positive("--for", seconds)
        if log is not None:
            raise ConfigError("--for is only for a bus; a log is read to its end")
    if channel is not None and log is None:
        raise ConfigError("--channel is only for a log; name a bus with --bus")
    title = str(log) if log is not None else f"{config.interface} {config.channel}"

    summary = Summary(config=config, key=key_of(config.key), most=MOST_MESSAGES)

    def table(now_s: float) -> RenderableType:
        return screen(summary, now_s, source=title, matching=match, width=console.width)

    if log is not None:
        _read(summary, log, channel)
        console.print(table(summary.last_s or 0.0))
        return
    from can_bridge.bus.backends.connection import open_bus

    with open_bus(config) as opened, until_stopped() as is_stopped:
        end = float("inf") if seconds is None else time.monotonic() + seconds
        _follow(opened, summary, table, lambda: is_stopped() or time.monotonic() >= end)


def _read(summary: "Summary", log: Path, channel: str | None) -> None:
    from can_bridge.logs.log_reader import CanLog

    messages = CanLog(log, channels=() if channel is None else (channel,))
    with progress("frames") as report:
        for number, message in enumerate(messages, 1):
            summary.add(message)
            report(f"reading {log.name}", number)
    if summary.last_s is None:
        raise BusError(f"{log}: contains no CAN frame")


def _follow(
    bus: "RawBus", summary: "Summary", table: Callable[[float], RenderableType], is_over: Callable[[], bool]
) -> None:
    """Show the table on a terminal. If there is no terminal, print a line per second, and the table at the end."""
    from rich.live import Live

    is_live = console.is_interactive
    interval = REFRESH_S if is_live else 1.0
    begin = shown = time.monotonic()
    with ExitStack() as stack:
        live = stack.enter_context(Live(console=console, auto_refresh=False)) if is_live else None
        while not is_over():
            _hear(bus, summary, REFRESH_S / 2)
            now = time.monotonic()
            if now - shown < interval:
                continue
            shown = now
            if live is None:
                console.print(line(summary, now - begin))
            else:
                live.update(table(now), refresh=True)
        # `Live` draws its last content again when it ends, so the last content must be the whole table.
        (console.print if live is None else live.update)(table(time.monotonic()))


def _hear(bus: "RawBus", summary: "Summary", wait_s: float) -> None:
    """Add the frames that have arrived to the summary; wait at most `wait_s` for the first frame. Each frame is stamped
    with the time of its reading, because interfaces have different clocks, which may jump."""
    for i in range(MOST_AT_ONCE):
        message = bus.receive_message(wait_s if i == 0 else 0.0)
        if message is None:
            break
        message.timestamp, message.channel = time.monotonic(), None
        summary.add(message)


def screen(summary: "Summary", now_s: float, *, source: str, matching: str, width: int) -> RenderableType:
    """Return the table, at least 80 characters wide, with its heading. `now_s` is the present time in s, on the clock
    of the frames' time stamps; `source` describes the bus or the log from which the frames come."""
    return Group(_heading(summary, matching, source), _table(summary, matching, round(now_s * 1e9), width))


def line(summary: "Summary", seconds: float) -> str:
    """Return the summary in one line, for output without a terminal."""
    return (
        f"{seconds:.0f} s: {summary.frames} data frames of {len(summary.messages)} messages, {summary.lost} lost, "
        f"{summary.refused} refused, {_others(summary)} remote or error frames"
    )


def _others(summary: "Summary") -> int:
    return summary.remote + summary.errors.total()


def _heading(summary: "Summary", matching: str, source: str) -> Text:
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


def _table(summary: "Summary", matching: str, now_ns: int, width: int) -> Table:
    from can_bridge.bus.conversion import id_text
    from can_bridge.tools.traffic import rows

    value = min(24, max(10, width - 70))  # the other columns take 70 characters with the longest names and numbers
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
        name = traffic.name or "unknown"
        table.add_row(
            Text(f"{traffic.channel} {name}" if several else name, style="bold"),
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
