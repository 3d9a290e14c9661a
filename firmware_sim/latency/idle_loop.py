"""The idle baseline: a process with the deadlines and privileges of the ECU, which does nothing when it wakes.

    python -m firmware_sim.latency.idle_loop FILE PERIOD_NS PERIODS any ECU_PID VEHICLE_PID
    python -m firmware_sim.latency.idle_loop FILE PERIOD_NS PERIODS PROCESSOR

After it has looked at the clock it notes what the system kept from the other two. A loop that is tied to one processor
shows whether that one stood still. SIGTERM ends it, or the last of PERIODS; then it writes FILE.
"""

import os
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from types import FrameType
from typing import Final

import numpy as np

from firmware_sim.ecu.real_time.clock import now_ns, sleep_until
from firmware_sim.ecu.real_time.deadlines import Deadlines
from firmware_sim.ecu.real_time.privileges import PRIORITY, Privilege, Wanted, in_words, taken
from firmware_sim.latency.idle_times import IdleStage, IdleTimes

LOOK_EVERY: Final = 25
"""Periods between two looks for new threads: half a second."""
_STEAL: Final = 8
"""Position in the first line of /proc/stat (proc(5)), whose first word is its name."""
_LINE: Final = 512
"""Bytes that hold any of the lines read here."""


def main(arguments: Sequence[str]) -> None:
    """Run until SIGTERM."""
    path, period_ns, periods, processor, *watched = arguments
    stopped: list[int] = []

    def stop(number: int, _frame: FrameType | None) -> None:
        stopped.append(number)

    signal.signal(signal.SIGTERM, stop)
    # Ctrl-C in a terminal reaches all processes of it; whoever started this one decides what ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with ExitStack() as stack:
        waited = [Waiting(int(pid), stack) for pid in watched]
        stolen = stolen_time(stack)
        privileges = stack.enter_context(taken(wanted(processor)))
        sys.stdout.write(f"{in_words(privileges)}\n")
        sys.stdout.flush()
        counters: list[Callable[[], int]] = [*waited, stolen or _nothing] if watched else []
        rows = run(int(period_ns), counters, lambda: bool(stopped), longest=int(periods))
    if not watched and not _goes_first(privileges):
        # Beside the ECU on one processor it would be late by the ECU's own work, and excuse it.
        rows = rows[:0]
    IdleTimes(rows=rows, knows_waiting=all(one.is_known for one in waited)).save(Path(path))


def wanted(processor: str) -> Wanted:
    """What the ECU asks for, and one more of priority: the work that it is compared with must not delay it."""
    return Wanted(priority=PRIORITY + 1, processor=None if processor == "any" else int(processor))


def run(
    period_ns: int, counters: Sequence[Callable[[], int]], is_stopped: Callable[[], bool], *, longest: int
) -> "np.ndarray[tuple[int, ...], np.dtype[np.int64]]":
    """Sleep from deadline to deadline until stopped, or for `longest` periods; rows of `IdleStage`.

    Args:
        period_ns: control period.
        counters: what the columns after WOKE sum up, in ns; the others stay 0.
        is_stopped: looked at once a period.
        longest: periods.
    """
    table = np.full((longest, len(IdleStage)), 0, dtype=np.int64)
    before = [counter() for counter in counters]
    deadlines = Deadlines(period_ns=period_ns, due_ns=now_ns() + period_ns)
    count = 0
    while count < longest and not is_stopped():
        sleep_until(deadlines.due_ns)
        woke = now_ns()
        now = [counter() for counter in counters]
        table[count, : IdleStage.WOKE + 1] = (deadlines.number, deadlines.due_ns, woke)
        table[count, IdleStage.WOKE + 1 : IdleStage.WOKE + 1 + len(now)] = [
            new - old for new, old in zip(now, before, strict=True)
        ]
        before, count = now, count + 1
        deadlines = deadlines.after(now_ns())
    return table[:count]


class Waiting:
    """How long a process was ready without a processor, ns, since this was made; it calls like a counter.

    Of its main thread, and of those others that have a real-time priority: the one that receives, but not one that
    writes logs. Threads that come later are found within `LOOK_EVERY` calls; after their end they are what they were.

    Args:
        pid: of the process.
        stack: closes what is opened.

    Attributes:
        is_known: whether this system tells.
    """

    def __init__(self, pid: int, stack: ExitStack) -> None:
        self._pid, self._stack = pid, stack
        self._readers: dict[int, tuple[Callable[[], int], int]] = {}
        self._calls = 0
        self._look()
        self.is_known = bool(self._readers)

    def __call__(self) -> int:
        self._calls += 1
        if self._calls % LOOK_EVERY == 0:
            self._look()
        return sum(read() - before for read, before in self._readers.values())

    def _look(self) -> None:
        for name in _names(Path(f"/proc/{self._pid}/task")):
            thread = int(name)
            if thread not in self._readers and (thread == self._pid or _is_urgent(thread)):
                read = _number(Path(f"/proc/{self._pid}/task/{thread}/schedstat"), 1, self._stack)
                if read is not None:
                    self._readers[thread] = read, read()


def stolen_time(stack: ExitStack) -> Callable[[], int] | None:
    """What reads the time that the host of a virtual machine kept from it, ns, in clock ticks; None if unknown."""
    ticks = _number(Path("/proc/stat"), _STEAL, stack)
    tick_ns = 1_000_000_000 // os.sysconf("SC_CLK_TCK")
    return None if ticks is None else lambda: ticks() * tick_ns


def _number(path: Path, position: int, stack: ExitStack) -> Callable[[], int] | None:
    try:
        file = os.open(path, os.O_RDONLY)
    except OSError:
        return None
    stack.callback(os.close, file)
    latest = 0

    def read() -> int:
        nonlocal latest
        with suppress(OSError, ValueError, IndexError):
            latest = int(os.pread(file, _LINE, 0).split()[position])
        return latest

    return read


def _goes_first(privileges: Sequence[Privilege]) -> bool:
    return any(item.granted and item.what.startswith("SCHED_FIFO") for item in privileges)


def _names(folder: Path) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []


def _is_urgent(thread: int) -> bool:
    try:
        return os.sched_getscheduler(thread) in (os.SCHED_FIFO, os.SCHED_RR)
    except OSError:
        return False


def _nothing() -> int:
    return 0


if __name__ == "__main__":
    main(sys.argv[1:])
