"""The join of two tables of stage times, made by hand: every stage takes a known time, and faults are planted."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from contract.errors import StillwakeError
from ecu.real_time.stage_times import NOTHING, EcuStage, VehicleStage
from firmware_sim.latency.idle_loop import IdleStage
from firmware_sim.latency.stages import Periods, Stage, Times, joined

MS = 1_000_000
PERIOD = 20 * MS
START = 7_000 * MS
COUNTERS = 256
IN_VEHICLE = [VehicleStage.PRESSURE_COUNTER, VehicleStage.ECHOED_COUNTER]
ON_ECU = {"bus_to_ecu": 0.5, "wait": 3.2, "receive": 0.25, "plan": 8.0, "gate": 0.125}
TOOK = {"sample": 0.3, **ON_ECU, "bus_to_vehicle": 0.4}
"""ms of each stage where nothing is planted; the sums are of whole nanoseconds."""


@dataclass
class Tables:
    count: int
    first_counter: int = 250
    vehicle: Times = field(init=False)
    ecu: Times = field(init=False)
    idle: Times = field(init=False)

    def __post_init__(self) -> None:
        ns = {name: round(ms * MS) for name, ms in TOOK.items()}
        self.vehicle = np.zeros((self.count, len(VehicleStage)), dtype=np.int64)
        self.ecu = np.zeros((self.count, len(EcuStage)), dtype=np.int64)
        self.idle = np.zeros((self.count, len(IdleStage)), dtype=np.int64)
        for i in range(self.count):
            scheduled = START + i * PERIOD
            sampled, arrived, due, plan, planned, stepped, command = (scheduled + np.cumsum(list(ns.values()))).tolist()
            counter = (self.first_counter + i) % COUNTERS
            # The vehicle's numbers begin at 100, the ECU's periods at 3: only the frames' counters connect them.
            self.vehicle[i] = (100 + i, scheduled, sampled, arrived, counter, command, counter, scheduled + PERIOD)
            self.ecu[i, : EcuStage.SENT + 1] = (
                *(3 + i, due, due + 50_000, counter, arrived, due + 60_000),
                *(plan, planned, stepped, command),
            )
            self.idle[i] = (i, scheduled + 5 * MS, scheduled + 5 * MS + 80_000)

    def join(self) -> Periods:
        return joined(self.vehicle, self.ecu, period_ns=PERIOD, counter_period=COUNTERS)

    def later(self, i: int, stage: EcuStage, ms: float) -> None:
        """Delay in the ECU's step i, from that stage on, with its command."""
        ns = round(ms * MS)
        self.ecu[i, [s for s in range(stage, EcuStage.SENT + 1)]] += ns
        self.vehicle[i, VehicleStage.COMMAND_ARRIVED] += ns

    def lose_command(self, i: int | slice) -> None:
        self.vehicle[i, [VehicleStage.COMMAND_ARRIVED, VehicleStage.ECHOED_COUNTER]] = (0, NOTHING)

    def lose_frame(self, i: int) -> None:
        """The ECU steps without it, and answers by the frame before."""
        self.ecu[i, [EcuStage.PRESSURE_COUNTER, EcuStage.FRAME_ARRIVED]] = (NOTHING, 0)
        self.ecu[i, [EcuStage.PLAN_BEGAN, EcuStage.PLAN_ENDED]] = 0
        self.vehicle[i, VehicleStage.ECHOED_COUNTER] = self.vehicle[i - 1, VehicleStage.PRESSURE_COUNTER]

    def stall_ecu(self, i: int, periods: int) -> None:
        """The ECU sleeps from step i on; step i + periods takes the newest frame."""
        gone = slice(i, i + periods)
        self.vehicle[gone, VehicleStage.COMMAND_ARRIVED] = 0
        self.vehicle[gone, VehicleStage.ECHOED_COUNTER] = NOTHING
        self.ecu = np.delete(self.ecu, gone, axis=0)

    def stall_vehicle(self, i: int, periods: int) -> None:
        """The vehicle leaves these out; its counter does not move, and the ECU's steps find nothing."""
        for j in range(i, i + periods):
            self.lose_frame(j)
        after = slice(i + periods, None)
        self.vehicle[after, IN_VEHICLE] = (self.vehicle[after, IN_VEHICLE] - periods) % COUNTERS
        self.ecu[after, EcuStage.PRESSURE_COUNTER] = (self.ecu[after, EcuStage.PRESSURE_COUNTER] - periods) % COUNTERS
        self.vehicle = np.delete(self.vehicle, slice(i, i + periods), axis=0)


ALL_MS = sum(TOOK.values())
ALL_NS = round(ALL_MS * MS)


def test_undisturbed_each_stage_takes_what_it_took():
    # 600 periods: the counter of eight bits begins again twice, that of classic frames with its four bits more often.
    for counters in (COUNTERS, 16):
        run = Tables(600)
        run.vehicle[:, IN_VEHICLE] %= counters
        run.ecu[:, EcuStage.PRESSURE_COUNTER] %= counters
        periods = joined(run.vehicle, run.ecu, period_ns=PERIOD, counter_period=counters)
        assert len(periods) == 599  # the last one's boundary lies after the run
        for name, ms in {**TOOK, "all": ALL_MS, "actuate": 0.0}.items():
            np.testing.assert_array_equal(periods.stages[Stage(name)], round(ms * MS), err_msg=f"{name}, {counters}")
        assert periods.missed.tolist() == []
        assert (periods.origin_ns, periods.planned) == (START, 599)


def test_answers_without_a_plan_do_not_make_the_loop_look_fast():
    run = Tables(60)
    run.ecu[:10, [EcuStage.PLAN_BEGAN, EcuStage.PLAN_ENDED]] = 0
    for i in range(20, 50):
        run.ecu[i, [EcuStage.PLAN_BEGAN, EcuStage.PLAN_ENDED]] = 0
        run.later(i, EcuStage.STEP_ENDED, -TOOK["plan"])
    run.lose_command(30)
    periods = run.join()
    # It begins with the first plan.
    assert (periods.origin_ns, len(periods), periods.missed.tolist()) == (START + 10 * PERIOD, 49, [20])
    of_all = periods.stages[Stage.ALL]
    assert np.flatnonzero(np.isfinite(of_all)).tolist() == [*range(10), 20, *range(40, 49)]
    assert np.nanmin(of_all) == ALL_NS


def test_a_command_after_the_boundary_is_a_miss_of_one_period():
    run = Tables(100)
    run.later(40, EcuStage.PLAN_ENDED, 8.0)
    run.vehicle[4, VehicleStage.COMMAND_ARRIVED] = START + 5 * PERIOD
    run.vehicle[6, VehicleStage.COMMAND_ARRIVED] = START + 7 * PERIOD + 1
    periods = run.join()
    assert periods.missed.tolist() == [6, 40]
    assert periods.stages[Stage.PLAN][40] == 16 * MS
    assert periods.stages[Stage.ALL][40] == ALL_NS + 8 * MS


def test_a_lost_frame_or_command_is_answered_by_the_next_command():
    for lose in (Tables.lose_frame, Tables.lose_command):
        run = Tables(60)
        lose(run, 30)
        for i in range(55, 60):
            run.lose_command(i)
        periods = run.join()
        # What nothing answered is infinitely late.
        assert periods.missed.tolist() == [30, 55, 56, 57, 58], lose
        assert np.isinf(periods.stages[Stage.ALL][55:]).all()
        assert periods.stages[Stage.ALL][30] == PERIOD + ALL_NS
        assert np.isnan(periods.stages[Stage.PLAN][30]) == (lose is Tables.lose_frame)


def test_no_period_of_a_node_that_slept_is_left_out():
    run = Tables(60)
    run.stall_ecu(20, 5)
    periods = run.join()
    assert periods.missed.tolist() == [20, 21, 22, 23, 24]
    # The command of period 25 answers all of them.
    assert periods.stages[Stage.ALL][20:25].tolist() == [(25 - i) * PERIOD + ALL_NS for i in range(20, 25)]
    began = 60_000
    assert sorted(periods.stalls[Stage.RECEIVE]) == [began + n * PERIOD for n in (1, 2, 3, 4, 5)]
    assert len(periods.values(Stage.RECEIVE)) == 59 + 5
    run = Tables(400)
    run.stall_vehicle(300, 3)
    periods = run.join()
    assert len(periods) == 399
    assert periods.missed.tolist() == [300, 301, 302]
    assert periods.stalls[Stage.SAMPLE].tolist() == [round(TOOK["sample"] * MS) + n * PERIOD for n in (3, 2, 1)]


def test_a_frame_after_its_step_waits_for_the_next():
    run = Tables(60)
    # Frame 30 comes 1 ms after step 30 began and is taken by step 31, which is given frame 31 too and uses that.
    run.lose_frame(30)
    # Frame 40 comes late, and frame 41 not at all: step 41 plans on frame 40.
    run.lose_frame(40)
    run.ecu[41, EcuStage.PRESSURE_COUNTER] = run.vehicle[40, VehicleStage.PRESSURE_COUNTER]
    run.ecu[41, EcuStage.FRAME_ARRIVED] = run.ecu[40, EcuStage.STEP_BEGAN] + MS
    run.vehicle[41, VehicleStage.ECHOED_COUNTER] = run.vehicle[40, VehicleStage.PRESSURE_COUNTER]
    assert run.join().missed.tolist() == [30, 40, 41]


def test_tables_that_are_of_no_run_are_refused():
    mixed, idle, empty = Tables(60), Tables(60), Tables(60)
    after = mixed.vehicle[30:, VehicleStage.PRESSURE_COUNTER]
    after[:] = (after + 7) % COUNTERS
    idle.ecu[:, [EcuStage.PLAN_BEGAN, EcuStage.PLAN_ENDED]] = 0
    empty.ecu = empty.ecu[:0]
    for run, message in ((mixed, "different runs"), (idle, "no plan"), (empty, "too few periods")):
        with pytest.raises(StillwakeError, match=message):
            run.join()
