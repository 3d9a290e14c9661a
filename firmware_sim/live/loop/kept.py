"""What the loop keeps of each of its latest periods: all that a saved run needs."""

from collections.abc import Mapping
from dataclasses import dataclass

from can_bridge.bus.simulated.medium import BusActivity
from firmware_sim.runs.run_log import BusTotals, Row


@dataclass(frozen=True, kw_only=True)
class Counted:
    """As of the start of a period.

    Attributes:
        activity: of the bus.
        bus: totals of the loop's own frames.
        acted: how often what disturbs the run then has acted, by its serial number.
    """

    activity: BusActivity
    bus: BusTotals
    acted: Mapping[int, int]


@dataclass(frozen=True, kw_only=True, eq=False)
class KeptPeriod:
    """One control period.

    Attributes:
        k: its number.
        requested: whether control was.
        before: what had been counted.
        planned_ns: what a step that planned took in virtual time; None without one.
        waits_ns: of the identifiers that were sent, the longest time from hand-over to the attempt that succeeded.
        frames: all on the bus, pickled: a tenth of what they take as objects, and of a node that babbles there are a
            quarter of a million in a minute.
    """

    k: int
    row: Row
    requested: bool
    before: Counted
    planned_ns: int | None
    waits_ns: Mapping[int, int]
    frames: bytes
