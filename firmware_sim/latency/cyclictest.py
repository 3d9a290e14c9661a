"""`cyclictest` (rt-tests), where it is installed: the machine's wake-up latency, measured by others."""

import re
import shutil
import subprocess
from dataclasses import dataclass
from typing import Final

PRIORITY: Final = 50
"""SCHED_FIFO: the ECU's."""
_THREAD: Final = re.compile(
    r"T:\s*\d+ .*?P:\s*(?P<priority>\d+) .*?C:\s*(?P<count>\d+) .*?"
    r"Min:\s*(?P<min>\d+) .*?Avg:\s*(?P<avg>\d+) .*?Max:\s*(?P<max>\d+)"
)


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
    program = shutil.which("cyclictest")
    if program is None:
        return None
    # Without --default-system it would keep the processors awake, also for the processes that are measured.
    command = [
        program,
        "--quiet",
        "--default-system",
        "--mlockall",
        f"--priority={PRIORITY}",
        f"--interval={period_ns // 1000}",
    ]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def ended(process: "subprocess.Popen[str]", timeout_s: float) -> Cyclictest | None:
    """Stop it and read what it found; None where it did not run, for example without permission."""
    process.terminate()
    output, _ = process.communicate(timeout=timeout_s)
    return parsed(output)


def parsed(output: str) -> Cyclictest | None:
    """Its summary line, whose times are in us."""
    line = _THREAD.search(output)
    if line is None or int(line["count"]) == 0:
        return None
    minimum, mean, maximum = (int(line[name]) / 1e3 for name in ("min", "avg", "max"))
    return Cyclictest(
        priority=int(line["priority"]), count=int(line["count"]), min_ms=minimum, mean_ms=mean, max_ms=maximum
    )
