"""What a vehicle counts while it runs: fixed in memory, however long that is."""

from collections import Counter
from dataclasses import dataclass, field
from math import ceil, isfinite, nan, sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from can_bridge.wire.messages import Mode

RESOLUTION_NS: Final = 10_000
LONGEST_NS: Final = 2_000_000_000
"""A time beyond it counts as it."""


class Durations:
    """Times, counted in steps of 10 us up to 2 s."""

    def __init__(self) -> None:
        self._counts: NDArray[np.int64] = np.zeros(LONGEST_NS // RESOLUTION_NS + 1, dtype=np.int64)
        self._total = 0

    def add(self, duration_ns: int) -> None:
        """One more."""
        self._counts[min(max(duration_ns, 0), LONGEST_NS) // RESOLUTION_NS] += 1
        self._total += 1

    def quantile_ms(self, share: float) -> float:
        """What this share does not exceed (nearest rank, down to 10 us), 1.0 for the largest; NaN without any."""
        if self._total == 0:
            return nan
        # 0.07 * 100 is 7.000000000000001 in binary: a rank is not to grow by rounding.
        rank = max(1, ceil(round(share * self._total, 6)))
        return int(np.searchsorted(np.cumsum(self._counts), rank)) * RESOLUTION_NS / 1e6


@dataclass(kw_only=True, eq=False)
class VehicleFigures:
    """Counts of one run.

    Attributes:
        periods: begun.
        left_out: periods that the vehicle itself did not begin, since it was late by more than half of one.
        unsampled: periods without pressures, since the live wake had not got there.
        commands: valid jet commands received.
        misses: periods, after the first valid command, that ended without one.
        at_once: commands that were for the period in which they came.
        unsent: pressure frames that the bus did not take.
        ages: from the sampling that a command rests on to its arrival.
        lateness: of the sampling, after its scheduled instant.
        modes: of the commands, by how often.
        latest_mode: of the newest command.
        ended: periods whose commands are known.
        squares: sum of the actions' squares over them.
        largest: magnitude of an action.
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
        """Over all periods that have ended, U_inf W; NaN before the first has."""
        return sqrt(self.squares / self.ended) if self.ended else nan

    def acted(self, action: float) -> None:
        """One more period's action."""
        self.ended += 1
        self.squares += action * action
        self.largest = max(self.largest, abs(action))

    def as_dict(self) -> dict[str, Any]:
        """The figures for a results file; None where nothing was measured."""
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
