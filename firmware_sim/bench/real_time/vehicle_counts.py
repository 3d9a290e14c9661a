"""Counts of a vehicle's run. Their memory does not grow with the length of the run."""

from collections import Counter
from dataclasses import dataclass, field
from math import ceil, isfinite, nan, sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from can_bridge.wire.messages import Mode

RESOLUTION_NS: Final = 10_000
LONGEST_NS: Final = 2_000_000_000
"""Longest time in ns that is counted exactly; a longer time is counted as this time."""


class Durations:
    """A histogram of times in steps of 10 us up to 2 s."""

    def __init__(self) -> None:
        self._counts: NDArray[np.int64] = np.zeros(LONGEST_NS // RESOLUTION_NS + 1, dtype=np.int64)
        self._total = 0

    def add(self, duration_ns: int) -> None:
        self._counts[min(max(duration_ns, 0), LONGEST_NS) // RESOLUTION_NS] += 1
        self._total += 1

    def quantile_ms(self, share: float) -> float:
        """Return the nearest-rank quantile in ms, rounded down to 10 us; NaN if there are no times."""
        if self._total == 0:
            return nan
        # In binary, 0.07 * 100 is 7.000000000000001. Without rounding, the rank would be 8 in place of 7.
        rank = max(1, ceil(round(share * self._total, 6)))
        return int(np.searchsorted(np.cumsum(self._counts), rank)) * RESOLUTION_NS / 1e6


@dataclass(kw_only=True, eq=False)
class VehicleFigures:
    """Counts of one run.

    Attributes:
        left_out: periods that the vehicle did not start, because it was late by at least half a period.
        unsampled: periods without pressures, because the live wake was late.
        misses: periods without a valid command, counted from the first valid command on.
        at_once: commands that acted in the period of their arrival.
        unsent: pressure frames that the bus did not accept.
        ages: times from the sampling of a command's pressures to the command's arrival.
        lateness: delays of the sampling after its scheduled instant.
        ended, squares: number of ended periods, and the sum of their squared actions in (U_inf W)^2.
        largest: largest magnitude of an action, in U_inf W.
    """

    periods: int = 0
    left_out: int = 0
    unsampled: int = 0
    commands: int = 0
    misses: int = 0
    at_once: int = 0
    unsent: int = 0
    ages: Durations = field(default_factory=Durations)
    lateness: Durations = field(default_factory=Durations)
    modes: Counter[Mode] = field(default_factory=Counter)
    latest_mode: Mode | None = None
    ended: int = 0
    squares: float = 0.0
    largest: float = 0.0

    @property
    def rms_action(self) -> float:
        """Root mean square of the action over all ended periods, in U_inf W; NaN before the end of the first period."""
        return sqrt(self.squares / self.ended) if self.ended else nan

    def as_dict(self) -> dict[str, Any]:
        """Return the figures for a results file; a figure without measurements is None."""
        counted = ("periods", "left_out", "unsampled", "commands", "misses", "unsent")
        measured = {
            **{name: getattr(self, name) for name in counted},
            "commands_for_their_own_period": self.at_once,
            **{
                f"{name}_{end}_ms": times.quantile_ms(share)
                for name, times in (("age", self.ages), ("lateness", self.lateness))
                for end, share in (("p50", 0.5), ("p99", 0.99), ("max", 1.0))
            },
            "rms_action": self.rms_action,
            "largest_action": self.largest,
        }
        found = {name: value if isfinite(value) else None for name, value in measured.items()}
        return {**found, "modes": {mode.name: count for mode, count in sorted(self.modes.items())}}
