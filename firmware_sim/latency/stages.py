"""The stages of each control period, from the sampling of the pressures to the command computed from them. The tables
of the vehicle and the ECU are joined by the pressure counter in the frames. The whole latency is measured from the
scheduled instant, not from the actual sampling. Periods that a node slept through are counted too: their pressures
count as answered when a command computed from later pressures arrives. Otherwise a loop that stalls for many periods
would count only one slow period (Tene's "coordinated omission")."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from contract.arrays import Array, Index
from contract.errors import StillwakeError
from ecu.real_time.stage_times import NOTHING, EcuStage, VehicleStage

Times = NDArray[np.int64]


class Stage(StrEnum):
    """The stages through which the pressures of one period pass, in order; `ALL` spans all stages before it."""

    SAMPLE = "sample"
    """The time from the scheduled sampling instant to the actual sampling: the vehicle's own delay."""
    BUS_TO_ECU = "bus_to_ecu"
    """The time from the sample to the receipt of the Pressure frame by the ECU's receive thread."""
    WAIT = "wait"
    """The time from the receipt of the frame to the deadline of the step that uses it. The wait absorbs bus jitter."""
    RECEIVE = "receive"
    """The time from the deadline, or from a later receipt, to the start of the plan: wake-up, checks, window."""
    PLAN = "plan"
    """The time that the encoder and the optimiser take."""
    GATE = "gate"
    """The time from the end of the plan to the finished frames: command gate, fail-safe, protection of the frames."""
    BUS_TO_VEHICLE = "bus_to_vehicle"
    """The time from the end of the ECU's step to the receipt of the JetCommand frame by the vehicle."""
    ALL = "all"
    """The time from the scheduled sampling instant to the arrival of the first command computed from these or newer
    pressures. If several commands arrive in a period, the newest counts, because the vehicle uses it. The command is
    due at the next sampling instant. Without a plan, the time is recorded only if the command was late."""
    ACTUATE = "actuate"
    """The time from the next sampling instant to the use of the command by the jets' driver."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Periods:
    """A sequence of n consecutive control periods, including periods that a node left out. Times are in ns from
    `origin_ns`, the scheduled instant of the first period on CLOCK_MONOTONIC. `scheduled`, shape (n,), has the sampling
    instants, and `answered`, shape (n,), the arrivals of the first commands computed from these or newer pressures;
    infinity if none. `stages` has the latencies in ns of each stage, shape (n,); NaN for a period without the stage.
    `stalls`, shape (m,), has for each of m periods that a node skipped the time in ns to the node's next period.
    `planned` counts the periods whose pressures were used for a plan."""

    period_ns: int
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
    """Join the tables, from the first period with a plan to the last period that has ended. `vehicle` has the columns
    `VehicleStage`, shape (k, stages), and `ecu` the columns `EcuStage`, shape (l, stages). The E2E counter of the
    Pressure frames repeats after `counter_period`. Raises StillwakeError for tables of different runs, or no plan."""
    sent = vehicle[vehicle[:, VehicleStage.SAMPLED] > 0]
    took = ecu[ecu[:, EcuStage.STEP_BEGAN] > 0]
    if len(sent) < 2 or not len(took):
        raise StillwakeError("the tables of stage times hold too few periods: did vehicle and ECU run together?")
    received, answers = took[:, EcuStage.FRAME_ARRIVED], sent[:, VehicleStage.COMMAND_ARRIVED]
    frame_of = _rows_by_counter(sent, took[:, EcuStage.PRESSURE_COUNTER], received, counter_period)
    echo_of = _rows_by_counter(sent, sent[:, VehicleStage.ECHOED_COUNTER], answers, counter_period)
    planned = frame_of[(took[:, EcuStage.PLAN_BEGAN] > 0) & (frame_of >= 0)]
    if not len(planned):
        raise StillwakeError("the ECU made no plan from the vehicle's pressures: was control requested, and granted?")
    if planned[0] >= len(sent) - 1:
        raise StillwakeError("the ECU's first plan arrived in the vehicle's last period: measure for longer")
    first, last = int(sent[planned[0], VehicleStage.PERIOD]), int(sent[-1, VehicleStage.PERIOD]) - 1
    # `numbers` has all periods. A period that the vehicle left out has no row of its own and uses the next row.
    numbers, own_number = np.arange(first, last + 1), sent[:, VehicleStage.PERIOD]
    row = np.searchsorted(own_number, numbers)
    instants = sent[row, VehicleStage.SCHEDULED] - (own_number[row] - numbers) * period_ns
    is_own = own_number[row] == numbers
    origin = int(instants[0])
    steps = np.full(len(sent), -1)  # for each of the vehicle's frames, the ECU's first step that used the frame
    taken = np.flatnonzero(frame_of >= 0)[::-1]
    steps[frame_of[taken]] = taken
    stages = {stage: np.full(len(instants), np.nan) for stage in Stage}
    own = np.flatnonzero(is_own)
    rows, step = row[own], steps[row[own]]
    _fill(stages, own, sent[rows], instants[own], took, step, period_ns)
    command = np.full(len(sent), np.inf)
    there = echo_of >= 0
    np.minimum.at(command, echo_of[there], (answers[there] - origin).astype(float))
    took_command = np.isfinite(command[rows]) & (step >= 0)
    ended = (took[step, EcuStage.STEP_ENDED] - origin).astype(float)
    stages[Stage.BUS_TO_VEHICLE][own[took_command]] = (command[rows] - ended)[took_command]
    answered = np.minimum.accumulate(command[::-1])[::-1][row]
    scheduled = (instants - origin).astype(float)
    # Commands without a plan are quick, so they count only if they are late: an ECU without control must not look fast.
    counts = np.isfinite(stages[Stage.PLAN]) | (answered > scheduled + period_ns)
    stages[Stage.ALL] = np.where(counts, answered - scheduled, np.nan)
    return Periods(
        period_ns=period_ns,
        origin_ns=origin,
        scheduled=scheduled,
        answered=answered,
        stages=stages,
        stalls={
            Stage.SAMPLE: (sent[row, VehicleStage.SAMPLED] - instants)[~is_own].astype(float),
            Stage.RECEIVE: _ecu_stalls(took, first_row=int(steps[row[0]]), end_ns=int(instants[-1])),
        },
        planned=int(np.isfinite(stages[Stage.PLAN]).sum()),
    )


def _rows_by_counter(sent: Times, counters: Times, arrived: Times, counter_period: int) -> Index:
    """Return for each received counter the index of the latest row that was sent with this counter; -1 if none was."""
    own, sampled = sent[:, VehicleStage.PRESSURE_COUNTER], sent[:, VehicleStage.SAMPLED]
    newest = np.searchsorted(sampled, arrived, side="right") - 1
    back = newest - (own[newest] - counters) % counter_period
    known = (counters != NOTHING) & (arrived > 0) & (newest >= 0) & (back >= 0)
    row = np.where(known, back, 0)
    wrong = known & (own[row] != counters)
    if wrong.any():
        counter = int(counters[np.argmax(wrong)])
        raise StillwakeError(f"no pressure frame with counter {counter} was sent: the tables are from different runs")
    return np.where(known, row, -1)


def _fill(
    stages: Mapping[Stage, Array], own: Index, sent: Times, scheduled: Times, took: Times, step: Index, period_ns: int
) -> None:
    """Fill in the latencies of the periods `own`, one per row of `sent`. `step` has the row's index in `took` or -1."""
    stages[Stage.SAMPLE][own] = sent[:, VehicleStage.SAMPLED] - scheduled
    acted = sent[:, VehicleStage.ACTUATED] > 0
    stages[Stage.ACTUATE][own[acted]] = (sent[:, VehicleStage.ACTUATED] - scheduled - period_ns)[acted]
    at, frames, steps = own[step >= 0], sent[step >= 0], took[step[step >= 0]]
    arrived, began, ended = steps[:, [EcuStage.FRAME_ARRIVED, EcuStage.PLAN_BEGAN, EcuStage.PLAN_ENDED]].T
    due = np.maximum(arrived, steps[:, EcuStage.SCHEDULED])
    stages[Stage.BUS_TO_ECU][at] = arrived - frames[:, VehicleStage.SAMPLED]
    stages[Stage.WAIT][at] = due - arrived
    has_plan = began > 0
    stages[Stage.RECEIVE][at[has_plan]] = (began - due)[has_plan]
    stages[Stage.PLAN][at[has_plan]] = (ended - began)[has_plan]
    stages[Stage.GATE][at[has_plan]] = (steps[:, EcuStage.STEP_ENDED] - ended)[has_plan]


def _ecu_stalls(took: Times, *, first_row: int, end_ns: int) -> Array:
    """Return times in ns, shape (m,): from the deadline of each period that the ECU left out to the ECU's next step."""
    rows = took[max(first_row, 0) :]
    rows = rows[rows[:, EcuStage.SCHEDULED] <= end_ns]
    stalls = []
    for before, after in pairwise(rows):
        left_out = int(after[EcuStage.PERIOD] - before[EcuStage.PERIOD]) - 1
        whole = int(after[EcuStage.SCHEDULED] - before[EcuStage.SCHEDULED]) / (left_out + 1)
        began = int(after[EcuStage.STEP_BEGAN] - after[EcuStage.SCHEDULED])
        stalls += [began + whole * (left_out - i) for i in range(left_out)]
    return np.array(stalls, dtype=float)
