"""The idle baseline: a process with the deadlines and privileges of the ECU, which does nothing when it wakes.

    python -m firmware_sim.latency.idle_loop FILE PERIOD_NS ECU_PID VEHICLE_PID

After it has looked at the clock it notes what the system kept from the other two. SIGTERM ends it; then it writes FILE.
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
from firmware_sim.ecu.real_time.privileges import Wanted, in_words, taken
from firmware_sim.ecu.real_time.stage_times import LONGEST
from firmware_sim.latency.idle_times import IdleStage, IdleTimes

_STEAL: Final = 8
"""Position in the first line of /proc/stat (proc(5)), whose first word is its name."""
_LINE: Final = 512
"""Bytes that hold any of the lines read here."""


def main(arguments: Sequence[str]) -> None:
    """Run until SIGTERM."""
    path, period_ns, *watched = arguments
    stopped: list[int] = []

    def stop(number: int, _frame: FrameType | None) -> None:
        stopped.append(number)

    signal.signal(signal.SIGTERM, stop)
    # Ctrl-C in a terminal reaches all processes of it; whoever started this one decides what ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with ExitStack() as stack:
        waited = [waiting_of(int(pid), stack) for pid in watched]
        stolen = stolen_time(stack)
        privileges = stack.enter_context(taken(Wanted()))
        print(in_words(privileges), flush=True)
        rows = run(int(period_ns), [*(reader or _nothing for reader in waited), stolen or _nothing], lambda: bool(stopped))
    IdleTimes(rows=rows, knows_waiting=all(reader is not None for reader in waited)).save(Path(path))


def run(
    period_ns: int, counters: Sequence[Callable[[], int]], is_stopped: Callable[[], bool], *, longest: int = LONGEST
) -> "np.ndarray[tuple[int, ...], np.dtype[np.int64]]":
    """Sleep from deadline to deadline until stopped, or for `longest` periods; rows of `IdleStage`.

    Args:
        period_ns: control period.
        counters: what the last columns sum up, in ns.
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
        table[count, IdleStage.WOKE + 1 :] = [new - old for new, old in zip(now, before, strict=True)]
        before, count = now, count + 1
        deadlines = deadlines.after(now_ns())
    return table[:count]


def waiting_of(pid: int, stack: ExitStack) -> Callable[[], int] | None:
    """What reads how long the main thread of a process was ready without a processor, ns; None where that is unknown.

    After the end of the process it is what it was.
    """
    return _number(Path(f"/proc/{pid}/schedstat"), 1, stack)


def stolen_time(stack: ExitStack) -> Callable[[], int] | None:
    """What reads the time that this virtual machine's host kept from it, ns, in steps of a clock tick; None if unknown."""
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


def _nothing() -> int:
    return 0


if __name__ == "__main__":
    main(sys.argv[1:])
