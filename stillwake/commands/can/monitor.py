"""The live view of a bus or a log: `stillwake can monitor`."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Protocol

import typer

from contract.errors import BusError, ConfigError
from stillwake.commands.can.options import BUS, Duration, key_of, positive
from stillwake.console.bus_option import BusName, with_bus
from stillwake.console.progress import INTERVAL
from stillwake.console.settings import settings
from stillwake.console.stopping import until_stopped
from stillwake.console.terminal import ConfigFile, Overrides, console

if TYPE_CHECKING:
    import can

    from can_bridge.tools.monitor import MonitorState
    from can_bridge.tools.raw_bus import RawBus

REFRESH_S = 0.1
"""Between two drawings of the table."""
ONCE_S = 1.0
"""How long --once listens to a bus."""
MOST_AT_ONCE = 2000
"""Frames between two looks at the keys, however fast they come."""


def monitor(
    log: Annotated[
        Path | None, typer.Option(help="Show this log in place of a bus, in its own time.", metavar="FILE")
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(help="Of a log: recorded seconds in one. Default: 1, and at once without a terminal."),
    ] = None,
    seconds: Duration = None,
    once: Annotated[
        bool, typer.Option("--once", help="Print the table once: of a bus after a second, of a log at its end.")
    ] = False,
    match: Annotated[str, typer.Option("--filter", help="Show rows with these words in message, id or signal.")] = "",
    bus_name: BusName = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Show every signal on a bus with value, unit, age, rate, losses and end-to-end check.

    Keys: q quits, space pauses, r resets, / filters, the arrows scroll.
    Without a terminal there is a line a second and the table at the end.

    lost counts frames that are missing by their counters, refused those that
    a receiver would not have used; E2E is the newest frame's check. With
    --set bus.key=FILE the MAC and freshness of secured messages are checked
    first. Of other messages it shows the bytes; `cantools monitor` decodes them.
    """
    from can_bridge.tools.monitor import MonitorState

    uses = ("bus.e2e", "bus.key") if log is not None else (*BUS, "bus.e2e", "bus.key")
    config = settings("can monitor", config_file, with_bus(bus_name, overrides), uses=uses).config.bus
    if speed is not None:
        positive("--speed", speed)
        if log is None:
            raise ConfigError("--speed: goes with --log; a bus has its own time")
    if seconds is not None:
        positive("--for", seconds)
    state = MonitorState(e2e=config.e2e, key=key_of(config.key))
    is_live = not once and console.is_interactive
    with ExitStack() as stack:
        if log is not None:
            pace = speed if speed is not None else (1.0 if is_live else None)
            source: _Source = _LogSource(log, pace)
            title = str(log)
        else:
            from can_bridge.tools.raw_bus import open_bus

            source = _BusSource(stack.enter_context(open_bus(config)))
            title = f"{config.interface} {config.channel}"
            seconds = ONCE_S if once and seconds is None else seconds
        is_stopped = stack.enter_context(until_stopped())
        show = _live if is_live else _lines
        state = show(state, source, is_stopped, title=title, seconds=seconds, match=match, quiet=once)
    if not is_live:
        _print_table(state, source, title, match)
    if log is not None and not state.frames and not state.others:
        raise BusError(f"{log}: holds no CAN frame")


class _Source(Protocol):
    """Where frames come from."""

    def take(self, state: "MonitorState", wait_s: float) -> "MonitorState":
        """The state after the frames that are there, having waited at most so long for the first."""

    def now_ns(self) -> int:
        """In the clock of the frames."""

    @property
    def has_ended(self) -> bool: ...


@dataclass
class _BusSource:
    """Frames of a bus, stamped when they are taken from it: clocks of interfaces differ, and jump."""

    bus: "RawBus"
    has_ended: bool = False

    def take(self, state: "MonitorState", wait_s: float) -> "MonitorState":
        for i in range(MOST_AT_ONCE):
            message = self.bus.receive_message(wait_s if i == 0 else 0.0)
            if message is None:
                break
            state = _seen(state, message, time.monotonic_ns())
        return state

    def now_ns(self) -> int:
        return time.monotonic_ns()


class _LogSource:
    """Frames of a log, in its time."""

    def __init__(self, path: Path, speed: float | None) -> None:
        from can_bridge.logs.log_reader import check_suffix, read_messages

        check_suffix(path)
        self._messages: Iterator[can.Message] = read_messages(path)
        self._next = next(self._messages, None)
        self._speed = speed
        self._first_s = 0.0 if self._next is None else self._next.timestamp
        self._begin = time.monotonic()
        self._last_ns = round(self._first_s * 1e9)

    @property
    def has_ended(self) -> bool:
        return self._next is None

    def take(self, state: "MonitorState", wait_s: float) -> "MonitorState":
        for i in range(MOST_AT_ONCE):
            if self._next is None:
                break
            left = self._due_in()
            if left > 0:
                if i == 0:
                    time.sleep(min(left, wait_s))
                break
            self._last_ns = max(self._last_ns, round(self._next.timestamp * 1e9))
            state = _seen(state, self._next, round(self._next.timestamp * 1e9))
            self._next = next(self._messages, None)
        return state

    def now_ns(self) -> int:
        if self._speed is None or self._next is None:
            return self._last_ns
        passed = (time.monotonic() - self._begin) * self._speed
        return max(self._last_ns, round((self._first_s + passed) * 1e9))

    def _due_in(self) -> float:
        if self._speed is None or self._next is None:
            return 0.0
        return self._begin + (self._next.timestamp - self._first_s) / self._speed - time.monotonic()


def _seen(state: "MonitorState", message: "can.Message", now_ns: int) -> "MonitorState":
    from can_bridge.tools.raw_bus import frame_of

    frame = frame_of(message)
    return state.seen_other() if frame is None else state.seen(replace(frame, timestamp_ns=now_ns))


def _lines(
    state: "MonitorState",
    source: _Source,
    is_stopped: Callable[[], bool],
    *,
    title: str,
    seconds: float | None,
    match: str,
    quiet: bool,
) -> "MonitorState":
    """A line a second; if `quiet`, as seldom as any command that works without a terminal."""
    from stillwake.commands.can.monitor_screen import line

    interval = INTERVAL if quiet else 1.0
    begin = shown = time.monotonic()
    while not (is_stopped() or source.has_ended or (seconds is not None and time.monotonic() - begin >= seconds)):
        state = source.take(state, REFRESH_S)
        now = time.monotonic()
        if now - shown >= interval:
            shown = now
            console.print(line(state, now - begin), soft_wrap=True, highlight=False)
    return state


def _live(
    state: "MonitorState",
    source: _Source,
    is_stopped: Callable[[], bool],
    *,
    title: str,
    seconds: float | None,
    match: str,
    quiet: bool,
) -> "MonitorState":
    """The table on the whole screen, until a key, a signal or the time ends it; a log's last table stays."""
    from rich.live import Live

    from can_bridge.tools.monitor import View, press
    from stillwake.commands.can.monitor_screen import key_reader, screen

    view = View(matching=match)
    has_keys = sys.stdin is not None and sys.stdin.isatty()
    begin = time.monotonic()
    frozen: tuple[MonitorState, int] | None = None
    with ExitStack() as stack:
        keys = stack.enter_context(key_reader()) if has_keys else list
        live = stack.enter_context(Live(console=console, screen=True, auto_refresh=False, transient=True))
        drawn = float("-inf")
        while not (is_stopped() or view.quits or (seconds is not None and time.monotonic() - begin >= seconds)):
            if source.has_ended:
                if not has_keys:
                    break
                time.sleep(REFRESH_S)
            state = source.take(state, REFRESH_S / 2)
            pressed = keys()
            for key in pressed:
                view = press(view, key)
                if view.resets:
                    state, frozen = state.reset(), None
            if view.is_paused and frozen is None:
                frozen = (state, source.now_ns())
            elif not view.is_paused:
                frozen = None
            if pressed or time.monotonic() - drawn >= REFRESH_S:
                drawn = time.monotonic()
                shown, now_ns = frozen or (state, source.now_ns())
                # No key may scroll past the end: the way back would be as long.
                view = replace(view, top=min(view.top, max(0, _row_count(shown, now_ns, view.matching) - 1)))
                # In front: a long path is cut off at its end.
                heading = f"ended: {title}" if source.has_ended else title
                drawing = screen(
                    shown, view, now_ns, source=heading, width=console.width, height=console.height, keys=has_keys
                )
                live.update(drawing, refresh=True)
    return state


def _row_count(state: "MonitorState", now_ns: int, matching: str) -> int:
    from can_bridge.tools.monitor import rows

    return len(rows(state, now_ns, matching=matching))


def _print_table(state: "MonitorState", source: _Source, title: str, match: str) -> None:
    from can_bridge.tools.monitor import View
    from stillwake.commands.can.monitor_screen import screen

    console.print(screen(state, View(matching=match), source.now_ns(), source=title, width=console.width))
