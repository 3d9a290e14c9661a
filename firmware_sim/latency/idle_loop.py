"""The idle loop for comparison: a process that wakes once in each control period, like the ECU, but does nothing. It
asks for real-time privileges, like the ECU.

    python -m firmware_sim.latency.idle_loop FILE PERIOD_NS PERIODS

On SIGTERM, or after PERIODS periods, the process writes its table to FILE and ends.
"""

import signal
import sys
from collections.abc import Callable, Sequence
from enum import IntEnum
from pathlib import Path
from typing import Final

import numpy as np

from contract.arrays import Array
from ecu.real_time.clock import now_ns, sleep_until
from ecu.real_time.deadlines import Deadlines
from ecu.real_time.privileges import PRIORITY, Wanted, in_words, taken
from ecu.real_time.stage_times import StageTimes
from firmware_sim.latency.stages import Times

_WANTED: Final = Wanted(priority=PRIORITY + 1)  # more than the ECU's, so that the ECU does not delay this loop


class IdleStage(IntEnum):
    """The columns of the idle loop's table; times in ns (CLOCK_MONOTONIC). Skipped periods have an index but no row."""

    PERIOD = 0
    SCHEDULED = 1
    WOKE = 2


def run(period_ns: int, is_stopped: Callable[[], bool], *, longest: int) -> StageTimes:
    """Sleep from deadline to deadline until `is_stopped` is true, at most `longest` periods; return the table."""
    table = StageTimes(IdleStage, longest)
    deadlines = Deadlines(period_ns=period_ns, due_ns=now_ns() + period_ns)
    for _ in range(longest):
        if is_stopped():
            break
        sleep_until(deadlines.due_ns)
        woke_ns = now_ns()
        table.begin()
        for stage, value in zip(IdleStage, (deadlines.number, deadlines.due_ns, woke_ns), strict=True):
            table.note(stage, value)
        deadlines = deadlines.after(now_ns())
    return table


def lateness(rows: Times, period_ns: int) -> Array:
    """Return the time in ns from each scheduled instant to the next wake-up, which may be some periods later."""
    numbers = np.arange(rows[0, IdleStage.PERIOD], rows[-1, IdleStage.PERIOD] + 1)
    own = rows[np.searchsorted(rows[:, IdleStage.PERIOD], numbers)]
    before = own[:, IdleStage.PERIOD] - numbers
    late: Array = (own[:, IdleStage.WOKE] - own[:, IdleStage.SCHEDULED] + before * period_ns).astype(float)
    return late


def main(arguments: Sequence[str]) -> None:
    path, period_ns, periods = arguments
    stopped: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _frame: stopped.append(number))
    # Ctrl-C reaches all processes of a terminal; only the parent process may end this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with taken(_WANTED) as privileges:
        sys.stdout.write(f"{in_words(privileges)}\n")
        sys.stdout.flush()
        table = run(int(period_ns), lambda: bool(stopped), longest=int(periods))
    table.save(Path(path))


if __name__ == "__main__":
    main(sys.argv[1:])
