"""Checks of the numbers in options, and texts with counts. An error states the option's name."""

import os
from collections.abc import Mapping
from math import isfinite
from typing import Any, Final

from contract.errors import ConfigError

_LONGEST: Final = 1e5
"""Longest time in t_c that an option accepts. Its simulation takes days, but its arrays still fit into memory."""


def steps_of(option: str, duration: float, period: float, *, least: int = 1) -> int:
    """Return the number of control periods in a duration. Raises ConfigError if the duration is not finite, too short,
    or above `_LONGEST`.

    Args:
        duration, period: the duration and the control period, in t_c.
        least: smallest number of control periods that is accepted.
    """
    if not (isfinite(duration) and duration <= _LONGEST):
        raise ConfigError(f"{option} {duration:g}: must be a number of t_c up to {_LONGEST:g}")
    steps = round(duration / period)
    if steps < least:
        plural = "period" if least == 1 else "periods"
        raise ConfigError(f"{option} {duration:g}: must be at least {least * period:g} t_c, {least} control {plural}")
    return steps


def listed(counts: Mapping[str, int]) -> str:
    """Return names with their counts in one line, the largest count first; counts of 0 are left out."""
    return ", ".join(f"{name} {count}" for name, count in sorted(counts.items(), key=lambda one: -one[1]) if count)


def workers_of(text: str | None) -> dict[str, Any]:
    """Return the arguments `workers` and `scheduler` for the value of `--workers`: a number of processes, by default
    one per core, or a scheduler's address. Raises ConfigError for another text."""
    if text is None:
        return {"workers": cores(), "scheduler": None}
    if ":" in text:
        return {"workers": 1, "scheduler": text}
    if not (text.isascii() and text.isdigit() and 0 < len(text) < 6 and int(text) > 0):
        raise ConfigError(f"--workers {text}: must be a number of processes, or an address such as tcp://10.0.0.1:8786")
    return {"workers": int(text), "scheduler": None}


def cores() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
