"""The judged run: counts, figures and first line, from made-up tables whose misses are known."""

import json

import numpy as np
import pytest

from contract.errors import StillwakeError
from firmware_sim.ecu.real_time.stage_times import EcuStage
from firmware_sim.latency.budget import Budget, verdicts
from firmware_sim.latency.cyclictest import Cyclictest
from firmware_sim.latency.idle_times import IdleStage
from firmware_sim.latency.measured import Measured
from firmware_sim.latency.report import PAGE, stage_rows, write_report
from firmware_sim.latency.running import Recorded
from firmware_sim.latency.stages import Stage
from tests.firmware_sim.latency.conftest import COUNTERS, MS, PERIOD, TOOK, Tables


def judged(run: Tables, name: str = "onnx", cyclictest: Cyclictest | None = None) -> Measured:
    recorded = Recorded(
        vehicle=run.vehicle, ecu=run.ecu, idle=run.idle_times, cyclictest=cyclictest, privileges="memory locked"
    )
    return Measured.of(recorded, name=name, about="a release", period_ns=PERIOD, counter_period=COUNTERS)


def with_two_misses(tables) -> Tables:
    """One by a garbage collection, one as the idle loop was late too."""
    run: Tables = tables(200)
    for i in (50, 120):
        run.later(i, EcuStage.STEP_ENDED, 8.0)
    run.ecu[50, EcuStage.COLLECTIONS] = 1
    run.idle[120, IdleStage.WOKE] += 9 * MS
    return run


def test_an_undisturbed_run(tables):
    run = judged(tables(200))
    assert run.counts == {"misses": 0, "misses_ours": 0, "misses_unexplained": 0}
    assert run.verdict == "All 199 commands came by the boundary they were due at."
    assert not run.is_too_noisy
    assert run.latencies[Stage.PLAN].max == TOOK["plan"]
    assert run.idle_latency.p50 == 0.08


def test_misses_and_noise_are_in_the_first_line(tables):
    run = judged(with_two_misses(tables))
    assert run.counts == {"misses": 2, "misses_ours": 1, "misses_unexplained": 0}
    assert run.is_too_noisy
    assert run.verdict.startswith("This machine is too noisy for a verdict: the idle loop itself was late by more than")
    assert "2 of 199 commands missed their boundary; 1 of these are ours or unexplained" in run.verdict
    assert "1 garbage collection" in run.verdict


def test_figures_are_strict_json_with_every_stage(tables):
    run = with_two_misses(tables)
    for i in range(195, 200):
        run.lose_command(i)
    found = judged(run).figures()
    again = json.loads(json.dumps(found, allow_nan=False))
    assert again["periods"] == 199
    assert again["misses"] == 2 + 4
    assert again["causes"] == {"unknown": 4, "collection": 1, "idle_loop": 1}
    assert list(again["stages"]) == [stage.value for stage in Stage]
    for row in again["stages"].values():
        assert set(row) == {"p50_ms", "p99_ms", "p99_9_ms", "max_ms", "misses"}
    # Commands that never came have no finite lateness.
    assert again["stages"]["all"]["max_ms"] is None
    assert again["stages"]["all"]["misses"] == 6
    assert again["baseline"]["misses"] == 1
    assert again["missed"][0]["late_ms"] is None
    assert sum(row["misses"] for name, row in again["stages"].items() if name != "all") == 6


def test_only_the_idle_loop_of_the_same_time_counts(tables):
    run = tables(200)
    run.idle[150:, IdleStage.WOKE] += 15 * MS
    run.vehicle, run.ecu = run.vehicle[:100], run.ecu[:100]
    assert not judged(run).is_too_noisy


def test_without_a_baseline_there_is_no_judgement(tables):
    run = tables(50)
    run.idle = run.idle[:0]
    with pytest.raises(StillwakeError, match="idle loop did not run"):
        judged(run)


def test_the_page_begins_with_the_verdict_and_has_its_pictures(tables, tmp_path):
    runs = [judged(with_two_misses(tables)), judged(tables(200), "c", CYCLIC)]
    budget = Budget(counts={"misses_ours": 0}, latencies={(Stage.PLAN, "max_ms"): 9.0})
    write_report(tmp_path, runs, [verdicts(budget, run.counts, run.latencies) for run in runs])
    page = (tmp_path / PAGE).read_text()
    assert page.startswith("onnx: This machine is too noisy")
    assert "| misses_ours | 0 | 1 | NO |" in page
    assert "| misses_ours | 0 | 0 | yes |" in page
    assert "| plan.max_ms | 9 | 8 | yes |" in page
    for name in ("histogram.png", "timeline_onnx.png", "timeline_c.png"):
        assert f"({name})" in page
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


def test_a_run_in_which_nothing_came_back_is_drawn_too(tables, tmp_path):
    run = tables(50)
    for i in range(5, 50):
        run.lose_command(i)
    write_report(tmp_path, [judged(run)], [[]])
    assert "never came" in (tmp_path / PAGE).read_text()


CYCLIC = Cyclictest(priority=50, count=201, min_ms=0.024, mean_ms=0.045, max_ms=0.889)


def test_rows_stand_for_themselves(tables):
    rows = list(stage_rows(judged(with_two_misses(tables), cyclictest=CYCLIC)))
    assert rows[0] == ("sample", "0.30", "0.30", "0.30", "0.30", "")
    assert rows[-1] == ("cyclictest (mean 0.04)", "", "", "", "0.89", "")
    assert rows[-2][0].startswith("idle loop")
    assert all(len(row) == 6 for row in rows)


def test_slack_of_a_loop_slower_than_its_period_makes_no_machine_noisy(tables):
    run = tables(100)
    for i in range(100):
        run.later(i, EcuStage.PLAN_ENDED, 9.0)
    found = judged(run)
    assert found.counts["misses_ours"] == 99
    # Without slack every waking up would count as one that missed.
    assert found.idle_misses == 0
    assert found.verdict.startswith("99 of 99 commands")
    assert np.isfinite(found.figures()["slack_ms"])
