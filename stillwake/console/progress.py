"""The display of progress: a bar on a terminal, lines of text in a log. Every command reports through `progress`.

Bar and lines use rich's `Progress`, which counts the steps and estimates the time left.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import inf
from threading import Event, Thread
from typing import Any, Final

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from stillwake.console.stopping import still_wanted
from stillwake.console.terminal import console as usual

SELDOM: Final = 0.1
"""Shortest time in s between two shown reports of a task, and from the task's start to its first shown report. Drawing
every report might take longer than the work."""
INTERVAL: Final = 30.0
"""Longest time in s between two printed lines. After a longer time a user may think that the command hangs."""
_HARDLY: Final = 1e-9
"""A part of a step that is too small to be seen in the count."""


class ProgressBar(Progress):
    """A display of bars on a terminal, which appears at the first update."""

    def __init__(self, *, console: Console, estimate_over: float, clock: Callable[[], float]) -> None:
        super().__init__(
            TextColumn("{task.description}", style="bold", markup=False),
            BarColumn(bar_width=12),
            MofNCompleteColumn(),
            TextColumn("{task.fields[unit]}", markup=False),
            TimeRemainingColumn(compact=True, elapsed_when_finished=True),
            _Note(),
            console=console,
            speed_estimate_period=estimate_over,
            get_time=clock,
        )

    def start(self) -> None:
        """Do nothing: the display starts at the first update, so that an earlier error is shown without a bar."""

    def update(self, task_id: TaskID, **changes: Any) -> None:
        """Update the task as rich does; the first update shows the bars. Raises KeyboardInterrupt if the exception of
        an earlier SIGTERM or SIGHUP was lost."""
        still_wanted()
        super().update(task_id, **changes)
        if not self.live.is_started:
            super().start()


class ProgressLines(Progress):
    """A display that prints a line at the first update, at least every `interval` seconds, and at the end of each task.

    A task gets a new line only if it has advanced since its last line. If no task has advanced during an interval, the
    task with the latest line gets another line, to show that the work continues. If a task's first step is long, such
    lines are also printed before its first update.
    """

    def __init__(
        self, *, console: Console, estimate_over: float, clock: Callable[[], float], interval: float = INTERVAL
    ) -> None:
        super().__init__(console=console, speed_estimate_period=estimate_over, get_time=clock, disable=True)
        self._interval = interval
        # The time of each task's latest line, and the count in it.
        self._lines: dict[TaskID, tuple[float, float]] = {}
        self._latest: TaskID | None = None
        self._ended = Event()
        self._heart = Thread(target=self._beat, name="progress", daemon=True)

    def start(self) -> None:
        """Start a thread that prints lines between updates: a step may take longer than the interval."""
        self._heart.start()

    def stop(self) -> None:
        """Print a line for each task whose last line does not show its present state."""
        self._ended.set()
        self._heart.join()
        with self._lock:
            for task in self._tasks.values():
                if task.id in self._lines and task.completed != self._lines[task.id][1]:
                    self._print(task)

    def update(self, task_id: TaskID, **changes: Any) -> None:
        """Update the task as rich does, and print a line if one is due or the task is done. Raises KeyboardInterrupt if
        the exception of an earlier SIGTERM or SIGHUP was lost."""
        still_wanted()
        super().update(task_id, **changes)
        with self._lock:
            task, last = self._tasks[task_id], self._lines.get(task_id)
            if last is None:
                # If several tasks start together, only the first task gets a line at its start.
                if task.completed > 0 or not self._lines:
                    self._print(task)
            elif task.completed != last[1]:
                self._latest = task_id
                if task.finished or self.get_time() - last[0] >= self._interval:
                    self._print(task)

    def _beat(self) -> None:
        while not self._ended.wait(self._interval / 4.0):
            with self._lock:
                shown = self._latest if self._latest is not None else next(reversed(self._tasks), None)
                if shown is not None:
                    began = self._tasks[shown].start_time
                    silent_since = max((at for at, _ in self._lines.values()), default=inf if began is None else began)
                    if self.get_time() - silent_since >= self._interval:
                        self._print(self._tasks[shown])

    def _print(self, task: Task) -> None:
        self._latest = task.id
        self._lines[task.id] = self.get_time(), task.completed
        self.console.print(line_of(task), markup=False, highlight=False, soft_wrap=True)


class Report:
    """A receiver of reports on tasks. A task begins with its first report; the steps in this report do not count for
    the speed.

    A report is shown immediately if no step is done, or if all steps are done and the task has been shown before. A
    task that ends before its first shown report is never shown.
    """

    def __init__(self, bar: Progress, unit: str, clock: Callable[[], float]) -> None:
        self._bar, self._unit, self._clock = bar, unit, clock
        self._tasks: dict[str, TaskID] = {}
        self._latest: dict[str, float] = {}
        self._waiting: dict[str, dict[str, Any]] = {}
        self._visible = set[str]()

    def __call__(self, task: str, done: float, total: float | None = None, note: str = "", *, unit: str = "") -> None:
        """Show the progress of a task with this name: the numbers of steps done so far and of the whole task, None if
        it is not known yet, and a note at the end of the line. `unit` is the unit of this task's steps, if it is not
        the display's unit. Raises KeyboardInterrupt if the exception of a signal was lost."""
        still_wanted()
        changes: dict[str, Any] = {"completed": done, "total": total, "note": note}
        now = self._clock()
        if task not in self._tasks:
            # Steps that an earlier call of the command did must not count for the speed.
            self._tasks[task] = self._bar.add_task(task, **changes, unit=unit or self._unit)
            # rich measures the speed from the end of the first step. So a tiny step is counted and taken back first;
            # otherwise real steps that end together would give a wrong speed.
            for part in (_HARDLY, -_HARDLY):
                Progress.update(self._bar, self._tasks[task], advance=part)
            self._latest[task] = now
        is_end = done == total and task in self._visible
        if done == 0 or is_end or now - self._latest[task] >= SELDOM:
            self._show(task, changes, now)
        else:
            self._waiting[task] = changes

    def show_what_is_left(self) -> None:
        """Show the latest report of every visible task, if it is not shown yet."""
        for task in self._visible & self._waiting.keys():
            self._show(task, self._waiting[task], self._clock())

    def _show(self, task: str, changes: dict[str, Any], now: float) -> None:
        self._waiting.pop(task, None)
        self._latest[task] = now
        self._visible.add(task)
        self._bar.update(self._tasks[task], **changes)


@contextmanager
def progress(
    unit: str, *, estimate_over: float = 30.0, console: Console = usual, clock: Callable[[], float] = time.monotonic
) -> Iterator[Report]:
    """Yield a report that shows a bar, a count in `unit` (a plural), the time left and a note. Without a terminal, the
    report prints lines of text instead. Nothing is shown before the first report, so that an error at the start is
    shown without a bar. The speed is averaged over `estimate_over` seconds to estimate the time left."""
    kind = ProgressBar if console.is_interactive else ProgressLines
    with kind(console=console, estimate_over=estimate_over, clock=clock) as bar:
        report = Report(bar, unit, clock)
        try:
            yield report
        finally:
            report.show_what_is_left()


@contextmanager
def phases(name: str, names: Sequence[str]) -> Iterator[tuple[Report, Callable[[str], None]]]:
    """Yield a report on a task with named phases, and a function to call with a phase's name at its beginning."""
    with progress("phases") as report:
        yield report, lambda begun: report(name, names.index(begun), len(names), begun)
        report(name, len(names), len(names))


def line_of(task: Task) -> str:
    """Return one line on a task: the completed share, the speed, the remaining time, and the note."""
    unit = task.fields["unit"]
    total = "" if task.total is None else f"/{_count(task.total)}"
    done = f"{task.description}: {_count(task.completed)}{total} {unit}"
    parts = [done if task.total is None else f"{done} ({task.percentage:.0f} %)"]
    if task.finished:
        parts.append(f"done in {span(task.finished_time or 0.0)}")
    else:
        if task.speed:
            parts.append(f"{task.speed:.3g} {unit}/s")
        if task.time_remaining is not None:
            parts.append(f"{span(task.time_remaining)} left")
        parts.append(f"{span(task.elapsed or 0.0)} so far")
    note = " ".join(task.fields["note"].split())
    return f"{', '.join(parts)}{f'; {note}' if note else ''}"


def span(seconds: float) -> str:
    """Return a time as text: 45 s, 3 min 20 s, 2 h 5 min, 12 days."""
    if seconds >= 100 * 3600:
        return f"{seconds / 86400.0:.3g} days"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def _count(number: float) -> str:
    return f"{number:.0f}" if abs(number) < 1e15 and number == round(number) else f"{number:g}"


class _Note(ProgressColumn):
    """A column with the task's note. On a narrow terminal, the end of the note is cut off."""

    def render(self, task: Task) -> Text:
        return Text(task.fields["note"], no_wrap=True, overflow="ellipsis")
