"""The join of the two tables against runs whose every stage is known."""

import numpy as np
import pytest

from contract.errors import StillwakeError
from firmware_sim.ecu.real_time.stage_times import EcuStage, VehicleStage
from firmware_sim.latency.stages import Stage, joined
from tests.firmware_sim.latency.conftest import COUNTERS, MS, PERIOD, START, TOOK, Tables

ALL_MS = sum(TOOK.values())


def test_undisturbed_each_stage_takes_what_it_took(tables):
    # 600 periods: the counter of eight bits begins again twice.
    periods = tables(600).join()
    assert len(periods) == 599  # the last one's boundary lies after the run
    for name, ms in TOOK.items():
        np.testing.assert_array_equal(periods.stages[Stage(name)], round(ms * MS))
    np.testing.assert_array_equal(periods.stages[Stage.ALL], round(ALL_MS * MS))
    np.testing.assert_array_equal(periods.stages[Stage.ACTUATE], 0)
    assert periods.missed.tolist() == []
    assert (periods.first, periods.origin_ns, periods.planned) == (100, START, 599)


def test_begins_with_the_first_plan(tables):
    run = tables(50)
    run.ecu[:32, [EcuStage.PLAN_BEGAN, EcuStage.PLAN_ENDED]] = 0
    periods = run.join()
    assert (periods.first, len(periods)) == (132, 17)


def test_answers_without_a_plan_do_not_make_the_loop_look_fast(tables):
    run = tables(60)
    for i in range(20, 50):
        run.ecu[i, [EcuStage.PLAN_BEGAN, EcuStage.PLAN_ENDED]] = 0
        run.later(i, EcuStage.STEP_ENDED, -TOOK["plan"])
    run.lose_command(30)
    periods = run.join()
    assert periods.missed.tolist() == [30]
    of_all = periods.stages[Stage.ALL]
    assert np.flatnonzero(np.isfinite(of_all)).tolist() == [*range(20), 30, *range(50, 59)]
    assert np.nanmin(of_all) == round(ALL_MS * MS)


def test_a_late_plan_is_a_miss_of_one_period(tables):
    run = tables(100)
    run.later(40, EcuStage.PLAN_ENDED, 8.0)
    periods = run.join()
    assert periods.missed.tolist() == [40]
    assert periods.stages[Stage.PLAN][40] == 16 * MS
    assert periods.stages[Stage.ALL][40] == round((ALL_MS + 8.0) * MS)


def test_at_the_boundary_a_command_is_in_time_and_a_nanosecond_after_it_is_not(tables):
    run = tables(10)
    run.vehicle[4, VehicleStage.COMMAND_ARRIVED] = START + 5 * PERIOD
    run.vehicle[6, VehicleStage.COMMAND_ARRIVED] = START + 7 * PERIOD + 1
    assert run.join().missed.tolist() == [6]


def test_a_lost_frame_or_command_is_answered_by_the_next_command(tables):
    for lose in (Tables.lose_frame, Tables.lose_command):
        run = tables(60)
        lose(run, 30)
        periods = run.join()
        assert periods.missed.tolist() == [30], lose
        assert periods.stages[Stage.ALL][30] == PERIOD + round(ALL_MS * MS)
        assert np.isnan(periods.stages[Stage.PLAN][30]) == (lose is Tables.lose_frame)


def test_no_period_of_an_ecu_that_slept_is_left_out(tables):
    run = tables(60)
    run.stall_ecu(20, 5)
    periods = run.join()
    assert periods.missed.tolist() == [20, 21, 22, 23, 24]
    # The command of period 25 answers all of them.
    expected = [(25 - i) * PERIOD + round(ALL_MS * MS) for i in range(20, 25)]
    assert periods.stages[Stage.ALL][20:25].tolist() == expected
    began = 60_000
    assert sorted(periods.stalls[Stage.RECEIVE]) == [began + n * PERIOD for n in (1, 2, 3, 4, 5)]
    assert len(periods.values(Stage.RECEIVE)) == 59 + 5


def test_no_period_of_a_vehicle_that_slept_is_left_out(tables):
    run = tables(400)
    run.stall_vehicle(300, 3)
    periods = run.join()
    assert len(periods) == 399
    assert periods.missed.tolist() == [300, 301, 302]
    sample = round(TOOK["sample"] * MS)
    assert periods.stalls[Stage.SAMPLE].tolist() == [sample + n * PERIOD for n in (3, 2, 1)]


def test_a_frame_after_its_step_waits_for_the_next(tables):
    run = tables(60)
    # Frame 30 comes 1 ms after step 30 began and is taken by step 31, which is given frame 31 too and uses that.
    run.lose_frame(30)
    # Frame 40 comes late, and frame 41 not at all: step 41 plans on frame 40.
    run.lose_frame(40)
    run.ecu[41, EcuStage.PRESSURE_COUNTER] = run.vehicle[40, VehicleStage.PRESSURE_COUNTER]
    run.ecu[41, EcuStage.FRAME_ARRIVED] = run.ecu[40, EcuStage.STEP_BEGAN] + MS
    run.vehicle[41, VehicleStage.ECHOED_COUNTER] = run.vehicle[40, VehicleStage.PRESSURE_COUNTER]
    periods = run.join()
    assert periods.missed.tolist() == [30, 40, 41]


def test_pressures_that_nothing_answered_are_infinitely_late(tables):
    run = tables(50)
    for i in range(45, 50):
        run.lose_command(i)
    periods = run.join()
    assert periods.missed.tolist() == [45, 46, 47, 48]
    assert np.isinf(periods.stages[Stage.ALL][45:]).all()


def test_classic_frames_with_their_counter_of_four_bits(tables):
    run = tables(200)
    for table, column in (
        (run.vehicle, VehicleStage.PRESSURE_COUNTER),
        (run.vehicle, VehicleStage.ECHOED_COUNTER),
        (run.ecu, EcuStage.PRESSURE_COUNTER),
    ):
        table[:, column] %= 16
    periods = joined(run.vehicle, run.ecu, period_ns=PERIOD, counter_period=16)
    np.testing.assert_array_equal(periods.stages[Stage.ALL], round(ALL_MS * MS))


def test_tables_of_different_runs_are_refused(tables):
    run = tables(60)
    run.vehicle[30:, VehicleStage.PRESSURE_COUNTER] = (run.vehicle[30:, VehicleStage.PRESSURE_COUNTER] + 7) % COUNTERS
    with pytest.raises(StillwakeError, match="different runs"):
        run.join()


def test_a_run_without_a_plan_and_empty_tables_are_refused(tables):
    run = tables(60)
    run.ecu[:, [EcuStage.PLAN_BEGAN, EcuStage.PLAN_ENDED]] = 0
    with pytest.raises(StillwakeError, match="no plan"):
        run.join()
    run.ecu = run.ecu[:0]
    with pytest.raises(StillwakeError, match="no two periods"):
        run.join()
