"""Numbers as options take them: what no later step could use is refused by the option's name. And counts in words."""

import os
from collections.abc import Mapping
from math import isfinite
from typing import Any, Final

from contract.errors import ConfigError

_LONGEST: Final = 1e5
"""t_c: days of computing on any machine, and still an array that fits into its memory."""


def steps_of(option: str, duration: float, period: float, *, least: int = 1) -> int:
    """Control periods in a duration. Raises ConfigError if the duration is not finite, shorter than needed, or longer
    than `_LONGEST`.

    Args:
        duration, period: in t_c.
        least: control periods that are needed.
    """
    if not (isfinite(duration) and duration <= _LONGEST):
        raise ConfigError(f"{option} {duration:g}: must be a number of t_c up to {_LONGEST:g}")
    steps = round(duration / period)
    if steps < least:
        plural = "period" if least == 1 else "periods"
        raise ConfigError(f"{option} {duration:g}: must be at least {least * period:g} t_c, {least} control {plural}")
    return steps


def listed(counts: Mapping[str, int]) -> str:
    """Counts in one line, the largest first; those of 0 are left out."""
    return ", ".join(f"{name} {count}" for name, count in sorted(counts.items(), key=lambda one: -one[1]) if count)


def workers_of(text: str | None) -> dict[str, Any]:
    """`workers` and `scheduler` of `--workers`: so many processes, one a core by default, or those of a scheduler.
    Raises ConfigError for another text."""
    if text is None:
        return {"workers": cores(), "scheduler": None}
    if ":" in text:
        return {"workers": 1, "scheduler": text}
    if not (text.isascii() and text.isdigit() and 0 < len(text) < 6 and int(text) > 0):
        raise ConfigError(f"--workers {text}: must be a number of processes, or an address such as tcp://10.0.0.1:8786")
    return {"workers": int(text), "scheduler": None}


def cores() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
