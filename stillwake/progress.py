"""How far work is: a bar on a terminal, lines of text in a log.

Both are rich's `Progress`, which counts and estimates.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from threading import Event, Thread
from typing import Any, Final

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TaskID, TimeRemainingColumn
from rich.table import Column
from rich.text import Text

INTERVAL: Final = 30.0
"""Seconds between two lines at most, before whoever waits takes the silence for a failure."""


class ProgressBar(Progress):
    """Bars on a terminal, from the first update on."""

    def __init__(self, unit: str, *, console: Console, estimate_over: float, clock: Callable[[], float]) -> None:
        super().__init__(
            _Words(lambda task: task.description, style="bold"),
            BarColumn(bar_width=12),
            MofNCompleteColumn(),
            _Words(lambda task: unit),
            TimeRemainingColumn(compact=True, elapsed_when_finished=True),
            _Note(),
            console=console,
            speed_estimate_period=estimate_over,
            get_time=clock,
        )

    def start(self) -> None:
        """Wait for the first update: an error before it stands alone."""

    def update(self, task_id: TaskID, **changes: Any) -> None:
        """As rich's; the first one shows the bars."""
        super().update(task_id, **changes)
        if not self.live.is_started:
            super().start()


class ProgressLines(Progress):
    """A line of text at the first update of a task, at least every `interval` seconds, and at the end."""

    def __init__(
        self,
        unit: str,
        *,
        console: Console,
        estimate_over: float,
        clock: Callable[[], float],
        interval: float = INTERVAL,
    ) -> None:
        super().__init__(console=console, speed_estimate_period=estimate_over, get_time=clock, disable=True)
        self._unit, self._interval = unit, interval
        self._printed: dict[TaskID, _Line] = {}
        self._touched: set[TaskID] = set()
        self._ended = Event()
        self._heart = Thread(target=self._beat, name="progress", daemon=True)

    def start(self) -> None:
        """Let time alone bring a line too: one step of the work may take longer than the interval."""
        self._heart.start()

    def stop(self) -> None:
        """Print where each task stands, unless its last line says so."""
        self._ended.set()
        self._heart.join()
        self._print(due=0.0)

    def update(self, task_id: TaskID, **changes: Any) -> None:
        """As rich's; prints a line if one is due or the task is done."""
        super().update(task_id, **changes)
        self._touched.add(task_id)
        self._print(due=self._interval)

    def _beat(self) -> None:
        while not self._ended.wait(self._interval / 4.0):
            self._print(due=self._interval)

    def _print(self, *, due: float) -> None:
        """A line for every task that has none since `due` seconds, or whose end has none."""
        with self._lock:
            now = self.get_time()
            for task in self._tasks.values():
                if task.id not in self._touched:
                    continue
                last = self._printed.get(task.id, _Line(-inf, "", False))
                line = _Line(now, line_of(task, self._unit), task.finished)
                if line.text != last.text and (now - last.at >= due or (line.is_end and not last.is_end)):
                    self._printed[task.id] = line
                    self.console.print(line.text, markup=False, highlight=False, soft_wrap=True)


def line_of(task: Task, unit: str) -> str:
    """One line on a task: how much of it is done, how fast it goes, how long it will take, and its note."""
    total = "" if task.total is None else f"/{task.total:g}"
    done = f"{task.description}: {task.completed:g}{total} {unit}"
    parts = [done if task.total is None else f"{done} ({task.percentage:.0f} %)"]
    if task.finished:
        parts.append(f"done in {span(task.finished_time or 0.0)}")
    else:
        if task.speed:
            parts.append(f"{task.speed:.3g} {unit}/s")
        if task.time_remaining is not None:
            parts.append(f"{span(task.time_remaining)} left")
        parts.append(f"{span(task.elapsed or 0.0)} so far")
    note = " ".join(str(task.fields.get("note", "")).split())
    return f"{', '.join(parts)}{f'; {note}' if note else ''}"


def span(seconds: float) -> str:
    """A time for people: 45 s, 3 min 20 s, 2 h 5 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


@dataclass(frozen=True)
class _Line:
    """A line on a task: when it was printed, and whether it says that the task is done."""

    at: float
    text: str
    is_end: bool


class _Words(ProgressColumn):
    """Text as it is, never broken."""

    def __init__(self, text: Callable[[Task], str], style: str = "") -> None:
        super().__init__(Column(no_wrap=True))
        self._text, self._style = text, style

    def render(self, task: Task) -> Text:
        return Text(self._text(task), style=self._style, no_wrap=True)


class _Note(ProgressColumn):
    """The note: the column that gives way where the terminal is narrow, cut at its end."""

    def render(self, task: Task) -> Text:
        return Text(str(task.fields.get("note", "")), no_wrap=True, overflow="ellipsis")
