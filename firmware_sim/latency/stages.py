"""The stages of each control period, from the sampling of the pressures to the command computed from them.

The tables of the vehicle and the ECU are joined by the pressure counter in the frames. The whole latency is measured
from the scheduled instant, not from the actual sampling. A period that a node slept through is not left out: its
pressures count as answered when a command computed from later pressures arrives. If such periods were left out, a loop
that stalls for many periods would count only one slow period (Tene's "coordinated omission").
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contract.arrays import Array, Index
from contract.errors import StillwakeError
from ecu.real_time.stage_times import NOTHING, EcuStage, VehicleStage

Times = NDArray[np.int64]


class Stage(StrEnum):
    """The stages through which the pressures of one period pass, in order."""

    SAMPLE = "sample"
    """The time from the scheduled sampling instant to the actual sampling: the vehicle's own delay."""
    BUS_TO_ECU = "bus_to_ecu"
    """The time from the sample to the receipt of the Pressure frame by the ECU's receive thread."""
    WAIT = "wait"
    """The time from the receipt of the Pressure frame to the deadline of the step that uses the frame; this time
    absorbs jitter of the bus."""
    RECEIVE = "receive"
    """The time from the deadline (or, if the frame arrives later, from the receipt of the frame) to the controller's
    call: wake-up, checks, window."""
    PLAN = "plan"
    """The time that the encoder and the optimiser take."""
    GATE = "gate"
    """The time from the plan to the finished frames, for the command gate, the fail-safe and the protection of the
    frames."""
    BUS_TO_VEHICLE = "bus_to_vehicle"
    """The time from the end of the step to the receipt of the JetCommand frame by the vehicle."""
    ALL = "all"
    """The time from the scheduled sampling instant to the arrival of the first command computed from these or newer
    pressures. Only the newest command in each period is considered, because the vehicle uses only this command. The
    command is due at the next sampling instant. For a period without a plan, the time is recorded only if the command
    arrived after it was due."""
    ACTUATE = "actuate"
    """The time from the next sampling instant to the use of the command by the jets' driver."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Periods:
    """Consecutive control periods, n in number, including periods that a node left out. Times are in ns from
    `origin_ns`.

    Attributes:
        period_ns: time from one sampling instant to the next.
        first: number of the first period in the vehicle's numbering.
        origin_ns: scheduled instant of the first period, CLOCK_MONOTONIC.
        scheduled: sampling instants, shape (n,).
        answered: arrival time of the first command computed from the period's pressures or newer pressures, shape (n,);
            infinite if there is no such command.
        stages: latencies of each stage, shape (n,); NaN where the stage did not occur.
        stalls: for a stage whose node left out m periods, the time from each of these periods to the next occurrence of
            the stage, shape (m,).
        planned: number of periods in which a plan was computed from the period's pressures.
    """

    period_ns: int
    first: int
    origin_ns: int
    scheduled: Array
    answered: Array
    stages: Mapping[Stage, Array]
    stalls: Mapping[Stage, Array]
    planned: int

    def __len__(self) -> int:
        return len(self.scheduled)

    @property
    def missed(self) -> Index:
        """Indices of the periods whose command had not arrived by the end of the period."""
        return np.flatnonzero(self.answered > self.scheduled + self.period_ns)

    def values(self, stage: Stage) -> Array:
        """Return all latencies of a stage in ns, including stalls; NaN where the stage did not occur."""
        return np.concatenate([self.stages[stage], self.stalls.get(stage, np.empty(0))])


def joined(vehicle: Times, ecu: Times, *, period_ns: int, counter_period: int) -> Periods:
    """Join the tables, from the first period with a plan to the last period that has ended. Raises StillwakeError if
    the tables are from different runs, or there was no plan.

    Args:
        vehicle: k rows with the columns `VehicleStage`, shape (k, stages).
        ecu: l rows with the columns `EcuStage`, shape (l, stages).
        counter_period: number of values of a Pressure frame's E2E counter before it repeats.
    """
    sent = vehicle[vehicle[:, VehicleStage.SAMPLED] > 0]
    took = ecu[ecu[:, EcuStage.STEP_BEGAN] > 0]
    if len(sent) < 2 or not len(took):
        raise StillwakeError("the tables of stage times hold no two periods: did vehicle and ECU run at the same time?")
    frame_of = _rows_by_counter(
        sent, took[:, EcuStage.PRESSURE_COUNTER], took[:, EcuStage.FRAME_ARRIVED], counter_period
    )
    echo_of = _rows_by_counter(
        sent, sent[:, VehicleStage.ECHOED_COUNTER], sent[:, VehicleStage.COMMAND_ARRIVED], counter_period
    )
    planned = frame_of[(took[:, EcuStage.PLAN_BEGAN] > 0) & (frame_of >= 0)]
    if not len(planned):
        raise StillwakeError("the ECU made no plan from the vehicle's pressures: was control requested, and granted?")
    if planned[0] >= len(sent) - 1:
        raise StillwakeError("the ECU's first plan arrived in the vehicle's last period: measure for longer")
    first, last = int(sent[planned[0], VehicleStage.PERIOD]), int(sent[-1, VehicleStage.PERIOD]) - 1
    grid = _Grid.over(sent, first, last, period_ns)
    origin = int(grid.scheduled[0])
    steps = _steps_by_frame(len(sent), frame_of)
    stages = {stage: np.full(len(grid.scheduled), np.nan) for stage in Stage}
    own = np.flatnonzero(grid.is_own)
    rows, step = grid.row[own], steps[grid.row[own]]
    _fill(stages, own, sent[rows], grid.scheduled[own], took, step, period_ns)
    command = np.full(len(sent), np.inf)
    there = echo_of >= 0
    arrivals = (sent[there, VehicleStage.COMMAND_ARRIVED] - origin).astype(float)
    np.minimum.at(command, echo_of[there], arrivals)
    took_command = np.isfinite(command[rows]) & (step >= 0)
    ended = (took[step, EcuStage.STEP_ENDED] - origin).astype(float)
    stages[Stage.BUS_TO_VEHICLE][own[took_command]] = (command[rows] - ended)[took_command]
    answered = np.minimum.accumulate(command[::-1])[::-1][grid.row]
    scheduled = (grid.scheduled - origin).astype(float)
    # Without a plan the ECU answers quickly. Answers in time without a plan are left out, so that an ECU that is not in
    # control does not appear fast.
    counts = np.isfinite(stages[Stage.PLAN]) | (answered > scheduled + period_ns)
    stages[Stage.ALL] = np.where(counts, answered - scheduled, np.nan)
    return Periods(
        period_ns=period_ns,
        first=first,
        origin_ns=origin,
        scheduled=scheduled,
        answered=answered,
        stages=stages,
        stalls={
            Stage.SAMPLE: _until_next(grid, sent[:, VehicleStage.SAMPLED]),
            Stage.RECEIVE: _ecu_stalls(took, first_row=int(steps[grid.row[0]]), end_ns=int(grid.scheduled[-1])),
        },
        planned=int(np.isfinite(stages[Stage.PLAN]).sum()),
    )


class _Grid(NamedTuple):
    """All n periods of the vehicle, with or without a row in its table.

    Attributes:
        scheduled: sampling instants, CLOCK_MONOTONIC in ns, shape (n,).
        row: index of the table's row for the period, or for the next period that was not left out, shape (n,).
        is_own: whether the row belongs to the period itself, shape (n,).
    """

    scheduled: Times
    row: Index
    is_own: NDArray[np.bool_]
    period_ns: int

    @classmethod
    def over(cls, sent: Times, first: int, last: int, period_ns: int) -> "_Grid":
        numbers = np.arange(first, last + 1)
        own = sent[:, VehicleStage.PERIOD]
        row = np.searchsorted(own, numbers)
        scheduled = sent[row, VehicleStage.SCHEDULED] - (own[row] - numbers) * period_ns
        return cls(scheduled, row, own[row] == numbers, period_ns)


def _rows_by_counter(sent: Times, counters: Times, arrived: Times, counter_period: int) -> Index:
    """Return, for each counter, the index of the vehicle's latest row that has this counter and was sent before the
    arrival time; -1 if there is no such row."""
    own, sampled = sent[:, VehicleStage.PRESSURE_COUNTER], sent[:, VehicleStage.SAMPLED]
    newest = np.searchsorted(sampled, arrived, side="right") - 1
    back = newest - (own[newest] - counters) % counter_period
    known = (counters != NOTHING) & (arrived > 0) & (newest >= 0) & (back >= 0)
    row = np.where(known, back, 0)
    wrong = known & (own[row] != counters)
    if wrong.any():
        counter = int(counters[np.argmax(wrong)])
        raise StillwakeError(f"no pressure frame of counter {counter} was sent: the tables are of different runs")
    return np.where(known, row, -1)


def _steps_by_frame(frames: int, frame_of: Index) -> Index:
    """Return, for each of the vehicle's frames, the ECU's first step that used the frame; -1 if there is no such
    step."""
    steps = np.full(frames, -1)
    taken = np.flatnonzero(frame_of >= 0)[::-1]
    steps[frame_of[taken]] = taken
    return steps


def _fill(
    stages: Mapping[Stage, Array],
    own: Index,
    sent: Times,
    scheduled: Times,
    took: Times,
    step: Index,
    period_ns: int,
) -> None:
    """Fill in the stages of the periods at the indices `own`, from the vehicle's rows and the ECU's steps (-1 for no
    step)."""
    stages[Stage.SAMPLE][own] = sent[:, VehicleStage.SAMPLED] - scheduled
    acted = sent[:, VehicleStage.ACTUATED] > 0
    after_boundary = sent[:, VehicleStage.ACTUATED] - scheduled - period_ns
    stages[Stage.ACTUATE][own[acted]] = after_boundary[acted]
    at, frames, steps = own[step >= 0], sent[step >= 0], took[step[step >= 0]]
    arrived = steps[:, EcuStage.FRAME_ARRIVED]
    due = np.maximum(arrived, steps[:, EcuStage.SCHEDULED])
    stages[Stage.BUS_TO_ECU][at] = arrived - frames[:, VehicleStage.SAMPLED]
    stages[Stage.WAIT][at] = due - arrived
    has_plan = steps[:, EcuStage.PLAN_BEGAN] > 0
    stages[Stage.RECEIVE][at[has_plan]] = (steps[:, EcuStage.PLAN_BEGAN] - due)[has_plan]
    stages[Stage.PLAN][at[has_plan]] = (steps[:, EcuStage.PLAN_ENDED] - steps[:, EcuStage.PLAN_BEGAN])[has_plan]
    stages[Stage.GATE][at[has_plan]] = (steps[:, EcuStage.STEP_ENDED] - steps[:, EcuStage.PLAN_ENDED])[has_plan]


def _until_next(grid: _Grid, sampled: Times) -> Array:
    """Return the time in ns from the scheduled instant of each period that the vehicle left out to the vehicle's next
    sample, shape (m,) for m such periods."""
    out = ~grid.is_own
    return (sampled[grid.row[out]] - grid.scheduled[out]).astype(float)


def _ecu_stalls(took: Times, *, first_row: int, end_ns: int) -> Array:
    """Return the time in ns from the deadline of each of the m periods that the ECU left out to the ECU's next step,
    shape (m,)."""
    rows = took[max(first_row, 0) :]
    rows = rows[rows[:, EcuStage.SCHEDULED] <= end_ns]
    stalls = []
    for before, after in pairwise(rows):
        left_out = int(after[EcuStage.PERIOD] - before[EcuStage.PERIOD]) - 1
        whole = int(after[EcuStage.SCHEDULED] - before[EcuStage.SCHEDULED]) / (left_out + 1)
        began = int(after[EcuStage.STEP_BEGAN] - after[EcuStage.SCHEDULED])
        stalls += [began + whole * (left_out - i) for i in range(left_out)]
    return np.array(stalls, dtype=float)
