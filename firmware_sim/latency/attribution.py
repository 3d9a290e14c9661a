"""Whose fault each missed boundary is: ours, or the machine's.

The machine is to blame only where what it is known to have kept from us was enough on its own: at its usual pace, its
medians, the loop would have missed that boundary too. That much is called the slack. Everything else is ours, what
nobody can explain included.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from contract.arrays import Array
from firmware_sim.ecu.real_time.stage_times import EcuStage
from firmware_sim.latency.idle_times import IdleStage, IdleTimes
from firmware_sim.latency.stages import CHAIN, Link, Periods, Stage, Times

SLOW_PLAN: Final = 2.0
"""Medians of the plan's time from which on a plan counts as slow: its work is the same each period, to an operation."""
MINOR_FAULT_NS: Final = 1_000
"""Of a page fault without reading: about 0.5 us on a bare machine, twice that in a virtual one."""


class Cause(StrEnum):
    """In the order in which they are looked for."""

    TOO_SLOW = "too slow at its usual pace"
    IDLE_LOOP = "an idle loop was late as well"
    WAITED = "no processor was free"
    STOLEN = "the virtual machine's host took the processor"
    COLLECTION = "garbage collection"
    PAGE_FAULTS = "page faults"
    PREEMPTED = "another process took the processor"
    SLOW_PLAN = "ONNX Runtime or the library was slow"
    UNKNOWN = "unexplained"

    @property
    def is_ours(self) -> bool:
        """Whether the machine is not to blame."""
        return self not in (Cause.IDLE_LOOP, Cause.WAITED, Cause.STOLEN, Cause.PREEMPTED)


@dataclass(frozen=True, kw_only=True)
class Miss:
    """One command that was not there by the boundary it was due at.

    Attributes:
        period: its number, as the vehicle counts.
        link: how far its pressures came.
        stage: which took the most beyond its median, or where they were lost.
        late_ms: after the boundary; infinite if no later command came either.
        slack_ms: what a delay had to be to be enough.
        cause: found first, in the order of `Cause`.
    """

    period: int
    link: Link
    stage: Stage
    late_ms: float
    slack_ms: float
    cause: Cause


class _Evidence(NamedTuple):
    """What is known of the time from a sampling instant to the next."""

    idle_late_ns: float
    waited_ns: float
    stolen_ns: float
    collections: int
    minor_faults: int
    major_faults: int
    switches: int
    plan_ns: float


def slack_ns(periods: Periods) -> float:
    """What is left of a period at the loop's usual pace."""
    return periods.period_ns - _median(periods.stages[Stage.ALL])


def attributed(periods: Periods, ecu: Times, idle: IdleTimes) -> list[Miss]:
    """Every miss with its cause.

    Args:
        periods: the tables joined.
        ecu: the ECU's rows, of `EcuStage`.
        idle: the idle loop's of the same run.
    """
    medians = {stage: _median(periods.stages[stage]) for stage in CHAIN}
    # A frame is in time only until the step it is due at.
    to_spare = {Link.NOT_IN_TIME: medians[Stage.WAIT]}
    found = []
    for i in map(int, periods.missed):
        link = periods.links[i]
        slack = to_spare.get(link, slack_ns(periods))
        begin = periods.origin_ns + int(periods.scheduled[i])
        evidence = _evidence(ecu, idle, begin, begin + periods.period_ns)
        found.append(
            Miss(
                period=periods.first + i,
                link=link,
                stage=_stage(periods, i, medians),
                late_ms=float(periods.answered[i] - periods.scheduled[i] - periods.period_ns) / 1e6,
                slack_ms=slack / 1e6,
                cause=_cause(evidence, slack, plan_median=medians[Stage.PLAN], knows_waiting=idle.knows_waiting),
            )
        )
    return found


def counted(misses: Sequence[Miss]) -> dict[Cause, int]:
    """How many of each cause, the most frequent first."""
    return dict(Counter(miss.cause for miss in misses).most_common())


def ours(misses: Sequence[Miss]) -> int:
    """How many of them are not the machine's, the unexplained ones included."""
    return sum(miss.cause.is_ours for miss in misses)


def _cause(evidence: _Evidence, slack: float, *, plan_median: float, knows_waiting: bool) -> Cause:
    """The rule, on what is known of one period; `docs/how-to/measure-latency.md` states it in words."""
    if not slack > 0.0:
        return Cause.TOO_SLOW
    rules = (
        (Cause.IDLE_LOOP, evidence.idle_late_ns >= slack),
        (Cause.WAITED, evidence.waited_ns >= slack),
        (Cause.STOLEN, evidence.stolen_ns >= slack),
        (Cause.COLLECTION, evidence.collections > 0),
        (Cause.PAGE_FAULTS, evidence.major_faults > 0 or evidence.minor_faults * MINOR_FAULT_NS >= slack),
        # How long it was away is not known then; where it is, WAITED has looked at it.
        (Cause.PREEMPTED, not knows_waiting and evidence.switches > 0),
        (Cause.SLOW_PLAN, evidence.plan_ns >= SLOW_PLAN * plan_median),
    )
    return next((cause for cause, holds in rules if holds), Cause.UNKNOWN)


def _evidence(ecu: Times, idle: IdleTimes, begin: int, end: int) -> _Evidence:
    rows = idle.rows
    loops = np.concatenate([rows, idle.elsewhere])
    asleep = (loops[:, IdleStage.SCHEDULED] < end) & (loops[:, IdleStage.WOKE] > begin)
    late = loops[asleep, IdleStage.WOKE] - loops[asleep, IdleStage.SCHEDULED]
    # What the ECU counted since its row before, up to the end of the row that ends within or after the period.
    ended = ecu[:, EcuStage.STEP_ENDED]
    before = np.concatenate([[np.iinfo(np.int64).min], ended[:-1]])
    at = (before < end) & (ended > begin)
    counts = ecu[at]
    plans = counts[:, EcuStage.PLAN_ENDED] - counts[:, EcuStage.PLAN_BEGAN]
    return _Evidence(
        idle_late_ns=float(late.max(initial=0)),
        waited_ns=sum(_waited(rows, node, begin, end) for node in (IdleStage.ECU_WAITED, IdleStage.VEHICLE_WAITED)),
        stolen_ns=_stolen(rows, begin, end),
        collections=int(counts[:, EcuStage.COLLECTIONS].sum()),
        minor_faults=int(counts[:, EcuStage.MINOR_FAULTS].sum()),
        major_faults=int(counts[:, EcuStage.MAJOR_FAULTS].sum()),
        switches=int(counts[:, EcuStage.SWITCHES].sum()),
        plan_ns=float(plans.max(initial=0)),
    )


def _waited(rows: Times, column: IdleStage, begin: int, end: int) -> float:
    """Of times summed up from row to row, what exceeds their median and can lie between two instants.

    A waiting is counted when it ends: what a row holds may have begun so much before it.
    """
    ends, amounts = rows[:, IdleStage.WOKE], rows[:, column].astype(float)
    if not len(rows):
        return 0.0
    starts = np.concatenate([ends[:1], ends[:-1]]) - amounts
    overlap = np.minimum(ends, end) - np.maximum(starts, begin)
    return float(np.clip(np.minimum(amounts - np.median(amounts), overlap), 0.0, None).sum())


def _stolen(rows: Times, begin: int, end: int) -> float:
    """What the host took in the rows that touch the time between two instants.

    It is counted in ticks of the clock, 10 ms mostly, and only when one is full.
    """
    ends = rows[:, IdleStage.WOKE]
    starts = np.concatenate([ends[:1], ends[:-1]])
    return float(rows[(ends > begin) & (starts < end), IdleStage.STOLEN].sum())


def _stage(periods: Periods, i: int, medians: dict[Stage, float]) -> Stage:
    """The stage to look at first."""
    lost_in = {
        Link.NOT_SAMPLED: Stage.SAMPLE,
        Link.NOT_TAKEN: Stage.RECEIVE,
        Link.NOT_PLANNED: Stage.PLAN,
        Link.NO_COMMAND: Stage.BUS_TO_VEHICLE,
    }
    link = periods.links[i]
    if link in lost_in:
        return lost_in[link]
    candidates = {Link.WHOLE: CHAIN, Link.OVERTAKEN: CHAIN[:-1]}.get(link, (Stage.SAMPLE, Stage.BUS_TO_ECU))
    excess = {stage: float(periods.stages[stage][i]) - medians[stage] for stage in candidates}
    if np.isnan(excess[Stage.BUS_TO_ECU]):
        # When the frame came is not known; a vehicle that was late by all there was to spare explains it.
        return Stage.SAMPLE if excess[Stage.SAMPLE] >= medians[Stage.WAIT] else Stage.BUS_TO_ECU
    return max(excess, key=lambda stage: excess[stage])


def _median(values: Array) -> float:
    found = values[np.isfinite(values)]
    return float(np.median(found)) if len(found) else float("nan")
