"""The live view of a bus, and the table of a log: `stillwake can monitor`."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contract.errors import BusError, ConfigError
from stillwake.commands.can.frames import BUS, Channel, key_of
from stillwake.console import options as shared
from stillwake.console.progress import progress
from stillwake.console.settings import DIAGNOSIS, settings, with_bus
from stillwake.console.stopping import until_stopped
from stillwake.console.terminal import console

if TYPE_CHECKING:
    from rich.console import RenderableType

    from can_bridge.tools.raw_bus import RawBus
    from can_bridge.tools.summary import Summary

REFRESH_S = 0.1
"""Time between two drawings of the table, in s."""
MOST_AT_ONCE = 2000
"""Largest number of frames read between two drawings, so that the table is also redrawn on a flooded bus."""

Duration = Annotated[float | None, typer.Option("--for", help="End after this number of seconds.", metavar="SECONDS")]


def monitor(
    log: Annotated[Path | None, typer.Argument(help="Log to read instead of a bus; the table shows its end.")] = None,
    channel: Channel = None,
    seconds: Duration = None,
    match: Annotated[str, typer.Option("--filter", help="Show rows with these words in message, id or signal.")] = "",
    bus: shared.Bus = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Show every signal on a bus with value, unit, age, rate, losses and end-to-end check.

    Ctrl-C ends the command and prints the whole table. Until then the table is cut off at the end of the screen;
    --filter shows fewer rows. Without a terminal the command prints one line per second, and the table at the end.

    The column "lost" counts the frames that are missing according to the counters, and the column "refused" the frames
    that a receiver would not have used. The column "E2E" shows the result of the newest frame's check. With --set
    bus.key=FILE the MAC and freshness of secured messages are checked first. Messages of other systems are shown as
    bytes; `cantools monitor` decodes these messages.
    """
    from can_bridge.tools.summary import MOST_MESSAGES, Summary
    from stillwake.commands.can.monitor_screen import screen

    uses = (*(BUS if log is None else ()), "bus.e2e", "bus.key", DIAGNOSIS)
    config = settings("can monitor", with_bus(bus, given), uses=uses).config.bus
    if seconds is not None:
        shared.positive("--for", seconds)
        if log is not None:
            raise ConfigError("--for: needs a bus; a log is read to its end")
    if channel is not None and log is None:
        raise ConfigError("--channel: needs a log; name a bus with --bus")
    title = str(log) if log is not None else f"{config.interface} {config.channel}"

    summary = Summary(config=config, key=key_of(config.key), most=MOST_MESSAGES)

    def table(now_s: float) -> "RenderableType":
        return screen(summary, now_s, source=title, matching=match, width=console.width)

    if log is not None:
        _read(summary, log, channel)
        console.print(table(summary.last_s or 0.0))
        return
    from can_bridge.tools.raw_bus import open_bus

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
        raise BusError(f"{log}: holds no CAN frame")


def _follow(
    bus: "RawBus", summary: "Summary", table: "Callable[[float], RenderableType]", is_over: Callable[[], bool]
) -> None:
    """Show the table on a terminal; without a terminal print a line per second, and the table at the end."""
    from rich.live import Live

    from stillwake.commands.can.monitor_screen import line

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
        last = table(time.monotonic())
        if live is None:
            console.print(last)
        else:
            # `Live` draws its last content again when it ends, so the last content must be the whole table.
            live.update(last)


def _hear(bus: "RawBus", summary: "Summary", wait_s: float) -> None:
    """Add the frames that have arrived to the summary; wait at most `wait_s` for the first frame.

    Each frame is stamped with the time of its reading, because interfaces have different clocks, which may jump.
    """
    for i in range(MOST_AT_ONCE):
        message = bus.receive_message(wait_s if i == 0 else 0.0)
        if message is None:
            break
        message.timestamp, message.channel = time.monotonic(), None
        summary.add(message)
