"""`cyclictest` (rt-tests), where it is installed: the machine's wake-up latency, measured by others."""

import re
import shutil
import subprocess
from dataclasses import dataclass
from typing import Final

# Without --default-system it would keep the processors awake, also for the processes that are measured. SCHED_FIFO
# with the ECU's priority.
_COMMAND: Final = ("cyclictest", "--quiet", "--default-system", "--mlockall", "--priority=50")
_THREAD: Final = re.compile(r"P:\s*(\d+) .*?C:\s*(\d+) .*?Min:\s*(\d+) .*?Avg:\s*(\d+) .*?Max:\s*(\d+)")


@dataclass(frozen=True, kw_only=True)
class Cyclictest:
    """The last line of its output.

    Attributes:
        priority: of SCHED_FIFO; 0 where that was not granted.
        count: wake-ups.
        min_ms, mean_ms, max_ms: lateness.
    """

    priority: int
    count: int
    min_ms: float
    mean_ms: float
    max_ms: float


def started(period_ns: int) -> "subprocess.Popen[str] | None":
    """Start cyclictest, which runs until `ended`; None where it is not installed."""
    if shutil.which(_COMMAND[0]) is None:
        return None
    command = [*_COMMAND, f"--interval={period_ns // 1000}"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def ended(process: "subprocess.Popen[str]", timeout_s: float) -> Cyclictest | None:
    """Stop it and read its output; None where it did not run, for example without permission."""
    process.terminate()
    return parsed(process.communicate(timeout=timeout_s)[0])


def parsed(output: str) -> Cyclictest | None:
    """Its summary line, whose times are in us."""
    line = _THREAD.search(output)
    if line is None:
        return None
    priority, count, least, mean, most = map(int, line.groups())
    if count == 0:
        return None
    return Cyclictest(priority=priority, count=count, min_ms=least / 1e3, mean_ms=mean / 1e3, max_ms=most / 1e3)
