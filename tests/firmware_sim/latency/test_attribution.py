"""Misses planted one by one in made-up tables: each has one cause, and that is the one to be found."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.ecu.real_time.stage_times import EcuStage, VehicleStage
from firmware_sim.latency.attribution import SLOW_PLAN, Cause, Miss, attributed, counted, ours, slack_ns
from firmware_sim.latency.idle_times import IdleStage
from firmware_sim.latency.stages import Link, Stage
from tests.examples import examples
from tests.firmware_sim.latency.conftest import MS, PERIOD, TOOK, Tables

SLACK_MS = 20.0 - sum(TOOK.values())


def judged(run: Tables) -> list[Miss]:
    return attributed(run.join(), run.ecu, run.idle_times)


def only(run: Tables) -> Miss:
    (miss,) = judged(run)
    return miss


def late_run(tables, *, by_ms: float = 8.0) -> Tables:
    """Period 40 has a command that comes after its boundary."""
    run = tables(100)
    run.later(40, EcuStage.STEP_ENDED, by_ms)
    return run


def test_no_miss_no_cause(tables):
    assert judged(tables(100)) == []


def test_slack_is_what_the_median_leaves_of_the_period(tables):
    assert slack_ns(tables(100).join()) == round(SLACK_MS * MS)


def test_nothing_known_is_ours(tables):
    miss = only(late_run(tables))
    assert miss.cause is Cause.UNKNOWN
    assert miss.cause.is_ours
    assert (miss.period, miss.link, miss.stage) == (140, Link.WHOLE, Stage.GATE)
    assert miss.late_ms == pytest.approx(8.0 - SLACK_MS, abs=1e-6)  # times are whole nanoseconds


@pytest.mark.parametrize(("late_ms", "cause"), [(SLACK_MS - 0.01, Cause.UNKNOWN), (SLACK_MS, Cause.IDLE_LOOP)])
def test_an_idle_loop_that_was_late_by_the_slack_shows_the_machine(tables, late_ms, cause):
    run = late_run(tables)
    run.idle[40, IdleStage.WOKE] = run.idle[40, IdleStage.SCHEDULED] + round(late_ms * MS)
    assert only(run).cause is cause


def test_an_idle_loop_that_was_late_in_another_period_excuses_nothing(tables):
    run = late_run(tables)
    for other in (38, 42):
        run.idle[other, IdleStage.WOKE] = run.idle[other, IdleStage.SCHEDULED] + 12 * MS
    assert only(run).cause is Cause.UNKNOWN


def test_an_idle_loop_asleep_from_the_period_before_counts(tables):
    run = late_run(tables)
    run.idle[39, IdleStage.WOKE] = run.idle[39, IdleStage.SCHEDULED] + 19 * MS
    assert only(run).cause is Cause.IDLE_LOOP


@pytest.mark.parametrize("column", [IdleStage.ECU_WAITED, IdleStage.VEHICLE_WAITED])
def test_waiting_for_a_processor(tables, column):
    run = late_run(tables)
    run.idle[41, column] = round((SLACK_MS + 0.5) * MS)
    assert only(run).cause is Cause.WAITED


@pytest.mark.parametrize(("row", "cause"), [(39, Cause.UNKNOWN), (40, Cause.IDLE_LOOP)])
def test_a_processor_that_stood_still_shows_in_the_loop_that_was_tied_to_it(tables, row, cause):
    run = late_run(tables)
    elsewhere = run.idle.copy()
    elsewhere[row, IdleStage.WOKE] += 9 * MS
    idle = replace(run.idle_times, elsewhere=elsewhere)
    (miss,) = attributed(run.join(), run.ecu, idle)
    assert miss.cause is cause


def test_waiting_that_is_usual_excuses_nothing(tables):
    # The median of the answer holds it already.
    run = late_run(tables)
    run.idle[:, IdleStage.ECU_WAITED] = 9 * MS
    assert only(run).cause is Cause.UNKNOWN


def test_waiting_that_ended_before_the_period_or_began_after_it_excuses_nothing(tables):
    run = late_run(tables)
    # Row 39 ends 14.92 ms before the period, row 43 begins 25.08 ms after its end: 18 ms of it cannot lie within.
    run.idle[[39, 43], IdleStage.ECU_WAITED] = 18 * MS
    assert only(run).cause is Cause.UNKNOWN


def test_waiting_is_counted_when_it_ends(tables):
    run = late_run(tables)
    # Counted between 25.08 and 45.08 ms after the sampling instant; 30 ms of it began at 15.08 ms at the latest.
    run.idle[42, IdleStage.ECU_WAITED] = 30 * MS
    assert only(run).cause is Cause.WAITED


@pytest.mark.parametrize(
    ("row", "cause"), [(39, Cause.UNKNOWN), (40, Cause.STOLEN), (41, Cause.STOLEN), (42, Cause.UNKNOWN)]
)
def test_a_tick_of_stolen_time(tables, row, cause):
    run = late_run(tables)
    run.idle[row, IdleStage.STOLEN] = 10 * MS
    assert only(run).cause is cause


def test_a_garbage_collection_is_ours(tables):
    run = late_run(tables)
    run.ecu[40, EcuStage.COLLECTIONS] = 1
    miss = only(run)
    assert miss.cause is Cause.COLLECTION
    assert miss.cause.is_ours


def test_one_between_two_steps_is_in_the_row_that_follows(tables):
    # The ECU stalls in what comes after step 39's frames; step 40 is left out.
    run = tables(100)
    run.stall_ecu(40, 1)
    run.ecu[40, EcuStage.COLLECTIONS] = 1  # now the row of period 41
    miss = only(run)
    assert (miss.period, miss.link, miss.stage, miss.cause) == (140, Link.NOT_TAKEN, Stage.RECEIVE, Cause.COLLECTION)


@pytest.mark.parametrize(
    ("column", "count", "cause"),
    [
        (EcuStage.MAJOR_FAULTS, 1, Cause.PAGE_FAULTS),
        (EcuStage.MINOR_FAULTS, 10, Cause.UNKNOWN),
        (EcuStage.MINOR_FAULTS, 10_000, Cause.PAGE_FAULTS),
    ],
)
def test_page_faults(tables, column, count, cause):
    run = late_run(tables)
    run.ecu[40, column] = count
    assert only(run).cause is cause


@pytest.mark.parametrize(("knows_waiting", "cause"), [(False, Cause.PREEMPTED), (True, Cause.UNKNOWN)])
def test_a_lost_processor_is_the_machines_only_where_its_length_is_unknown(tables, knows_waiting, cause):
    run = late_run(tables)
    run.knows_waiting = knows_waiting
    run.ecu[40, EcuStage.SWITCHES] = 2
    assert only(run).cause is cause


@pytest.mark.parametrize(("factor", "cause"), [(SLOW_PLAN - 0.05, Cause.UNKNOWN), (SLOW_PLAN, Cause.SLOW_PLAN)])
def test_a_slow_plan_is_ours(tables, factor, cause):
    run = tables(100)
    run.later(40, EcuStage.PLAN_ENDED, (factor - 1.0) * TOOK["plan"])
    miss = only(run)
    assert (miss.cause, miss.stage) == (cause, Stage.PLAN)
    assert miss.cause.is_ours


def test_the_machine_comes_before_what_is_ours(tables):
    run = late_run(tables)
    run.ecu[40, EcuStage.COLLECTIONS] = 1
    run.idle[40, IdleStage.WOKE] += 12 * MS
    assert only(run).cause is Cause.IDLE_LOOP


def test_a_frame_that_missed_its_step_had_only_the_wait_to_spare(tables):
    run = tables(100)
    run.lose_frame(40)
    miss = only(run)
    assert (miss.link, miss.stage, miss.slack_ms) == (Link.NOT_IN_TIME, Stage.BUS_TO_ECU, TOOK["wait"])
    assert miss.cause is Cause.UNKNOWN
    run.idle[40, IdleStage.WOKE] = run.idle[40, IdleStage.SCHEDULED] + round(TOOK["wait"] * MS)
    assert only(run).cause is Cause.IDLE_LOOP


def test_a_vehicle_that_was_late_by_all_there_was_to_spare(tables):
    run = tables(100)
    run.lose_frame(40)
    run.vehicle[40, VehicleStage.SAMPLED] += round((TOOK["wait"] + 0.1) * MS)
    miss = only(run)
    assert (miss.link, miss.stage) == (Link.NOT_IN_TIME, Stage.SAMPLE)


def test_a_loop_that_is_always_late_has_no_excuse(tables):
    run = tables(100)
    for i in range(100):
        run.later(i, EcuStage.PLAN_ENDED, 9.0)
    run.idle[:, IdleStage.WOKE] += 15 * MS
    misses = judged(run)
    assert len(misses) == 99
    assert counted(misses) == {Cause.TOO_SLOW: 99}
    assert ours(misses) == 99


def test_a_lost_command(tables):
    run = tables(100)
    run.lose_command(40)
    miss = only(run)
    assert (miss.link, miss.stage, miss.cause) == (Link.NO_COMMAND, Stage.BUS_TO_VEHICLE, Cause.UNKNOWN)


def test_a_late_command_that_the_next_one_overtook_is_not_blamed_on_the_bus(tables):
    run = tables(100)
    run.later(40, EcuStage.PLAN_ENDED, 9.0)
    run.lose_command(40)  # the vehicle notes the newest command of a period alone
    miss = only(run)
    assert (miss.link, miss.stage, miss.cause) == (Link.OVERTAKEN, Stage.PLAN, Cause.SLOW_PLAN)


def test_a_vehicle_that_slept_with_the_idle_loop(tables):
    run = tables(100)
    run.stall_vehicle(40, 2)
    run.idle = np.delete(run.idle, [40, 41], axis=0)
    run.idle[39, IdleStage.WOKE] = run.idle[39, IdleStage.SCHEDULED] + 2 * PERIOD
    assert [(miss.stage, miss.cause) for miss in judged(run)] == [(Stage.SAMPLE, Cause.IDLE_LOOP)] * 2


@given(
    st.lists(st.integers(0, 98), unique=True, max_size=20),
    st.lists(st.integers(0, 98), unique=True, max_size=20),
    st.lists(st.integers(0, 98), unique=True, max_size=20),
)
@examples(60)
def test_every_miss_has_one_cause_and_the_counts_add_up(late, collected, asleep):
    run = Tables(100)
    for i in late:
        run.later(i, EcuStage.STEP_ENDED, 7.9)
    run.ecu[collected, EcuStage.COLLECTIONS] = 1
    run.idle[asleep, IdleStage.WOKE] += 10 * MS
    misses = judged(run)
    assert [miss.period - 100 for miss in misses] == sorted(late)
    assert sum(counted(misses).values()) == len(misses)
    machine = [miss for miss in misses if not miss.cause.is_ours]
    assert ours(misses) == len(misses) - len(machine)
    # The idle loop sleeps from 5 ms into its own period to 15.08 ms: no other period is touched.
    assert [miss.period - 100 for miss in machine] == sorted(set(late) & set(asleep))
