"""Abstract interpretation by Frama-C's Eva: all inputs at once, and any number of turns of a loop.

Eva follows intervals and addresses in place of values, so it needs no bound, but relates few values to each other. An
alarm is a place where it cannot exclude undefined behaviour; a proof has none.
"""

import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal

_FLAGS: Final = (
    *("-machdep", "gcc_x86_64", "-warn-special-float", "none", "-eva-no-show-progress"),
    *("-eva-precision", "0", "-eva-auto-loop-unroll", "80"),
)
"""Flags of Frama-C: the machine of the other proofs, NaN and infinite numbers as values, short loops turn by turn."""
_ALARM: Final = re.compile(r"^\[eva:alarm\] (?:\S*/)?(\S+:\d+): Warning: *\n *(.*)", re.MULTILINE)
_STATEMENTS: Final = re.compile(r"(\d+) statements reached \(out of (\d+)\)")


def tool() -> Path | None:
    """Return the path of Frama-C; None if it is not installed."""
    found = shutil.which("frama-c")
    return Path(found) if found else None


def command(harness: Path, function: str, sources: Sequence[Path], folders: Sequence[Path]) -> list[str]:
    """Return the command that analyses a function of a harness with the sources that it calls."""
    include = "-cpp-extra-args=" + " ".join(f"-I{folder}" for folder in folders)
    return ["frama-c", *_FLAGS, include, str(harness), *map(str, sources), "-main", function, "-eva"]


def judged(output: str) -> tuple[Literal["proved", "failed", "open"], int, str]:
    """Return the verdict of an analysis, the number of statements that it reached, and the first alarm."""
    reached = _STATEMENTS.search(output)
    if reached is None:
        return "open", 0, "the analysis did not end"
    if alarm := _ALARM.search(output):
        return "failed", int(reached[1]), f"alarm at {alarm[1]}: {alarm[2]}"
    return ("proved" if "0 alarms generated" in output else "open"), int(reached[1]), ""
