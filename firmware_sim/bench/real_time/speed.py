"""Whether a live wake keeps up with its bus: what a control period costs on this machine, measured before the start."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Final

from contract.errors import PlantError
from wake.truck.truck_wake import TruckWake

PERIODS: Final = 20
"""Control periods that are timed."""
ROOM: Final = 0.9
"""Share of a control period that the solver may take: what is left is for handing the pressures over, and for a
processor that others use as well."""
COARSE: Final = (0.75, 15)
"""Refinement and time steps a control period of the fastest plant that was found on which the shipped controller does
what it does on the default grid (docs/explanation/solver.md)."""


@dataclass(frozen=True, kw_only=True)
class Speed:
    """Speed of a plant on a machine.

    Attributes:
        typical_ms: wall time of a control period, the median.
        worst_ms: the longest of those timed.
    """

    typical_ms: float
    worst_ms: float

    @classmethod
    def of(cls, times_ms: Sequence[float]) -> "Speed":
        """From single times."""
        return cls(typical_ms=median(times_ms), worst_ms=max(times_ms))

    def check(self, period_ms: float, *, refinement: float, substeps: int) -> str | None:
        """None if the plant keeps up; a warning if it does so only just. Raises PlantError if it does not, with how
        much it lacks and what would help."""
        if self.typical_ms > period_ms:
            lacking = self.typical_ms / (ROOM * period_ms)
            coarser = f" (--set flow.refinement={COARSE[0]:g} --set flow.substeps={COARSE[1]})"
            raise PlantError(
                f"the wake takes {self.typical_ms:.1f} ms for a control period of {period_ms:g} ms on this machine "
                f"(flow.refinement = {refinement:g}, flow.substeps = {substeps}): it cannot keep up. Take a coarser "
                f"grid and longer steps{coarser if refinement > COARSE[0] else ''}, "
                f"or a vehicle {lacking:.2g} times as slow (operating_point.speed)"
            )
        if self.typical_ms > ROOM * period_ms or self.worst_ms > period_ms:
            return (
                f"warning: the wake takes {self.typical_ms:.1f} ms, at worst {self.worst_ms:.1f} ms, for a control "
                f"period of {period_ms:g} ms: periods without pressures are to be expected"
            )
        return None


def measured(
    wake: TruckWake, periods: int = PERIODS, clock: Callable[[], float] = time.perf_counter
) -> tuple[float, ...]:
    """Wall time in ms of so many control periods without jets, sampling included; the wake is left as it was."""
    begin = wake.state()
    times = []
    for _ in range(periods):
        began = clock()
        wake.advance(0.0)
        times.append((clock() - began) * 1e3)
    wake.reset(begin)
    return tuple(times)
