"""The judged run: counts, figures and first line, from made-up tables whose misses are known."""

import json

import numpy as np
import pytest

from contract.errors import ConfigError, StillwakeError
from ecu.real_time.stage_times import EcuStage
from firmware_sim.latency import idle_loop, measured
from firmware_sim.latency.idle_loop import IdleStage, lateness
from firmware_sim.latency.measured import NEEDED_FOR_P99_9, KeptLimit, MeasuredRun, Quantiles, verdicts
from firmware_sim.latency.running import Recorded
from firmware_sim.latency.stages import Stage
from tests.firmware_sim.latency.test_stages import COUNTERS, MS, PERIOD, TOOK, Tables

SLACK_MS = 20.0 - sum(TOOK.values())


def judged(run: Tables, name: str = "onnx") -> MeasuredRun:
    recorded = Recorded(
        vehicle=run.vehicle, ecu=run.ecu, idle=run.idle, privileges="memory locked", fault="FAULT, IMPLAUSIBLE"
    )
    return MeasuredRun.of(recorded, name=name, about="a release", period_ns=PERIOD, counter_period=COUNTERS)


def test_percentiles_are_measured_values_by_nearest_rank():
    values = np.random.default_rng(0).permutation(np.arange(1, 1001)) * 1e6
    assert Quantiles.of(values) == (500.0, 990.0, 999.0, 1000.0, 1000)
    # 0.999 * 3000 is more than 2997 in binary; a rank too high would show here.
    assert Quantiles.of(np.arange(1.0, 3001.0) * 1e6).p99_9 == 2997.0
    for number, p99_9 in ((NEEDED_FOR_P99_9 - 1, NEEDED_FOR_P99_9 - 1), (NEEDED_FOR_P99_9, NEEDED_FOR_P99_9 - 1)):
        assert Quantiles.of(np.arange(1.0, number + 1.0) * 1e6).p99_9 == p99_9, number
    # What never came counts, and what was not due does not.
    assert Quantiles.of(np.array([1e6, np.nan, np.inf])) == (1.0, np.inf, np.inf, np.inf, 2)
    assert Quantiles.of(np.full(3, np.nan)) == (None, None, None, None, 0)


def with_two_misses(idle_late_ms: float) -> Tables:
    """Two late commands, and an idle loop that was so late in the second one's period."""
    run = Tables(200)
    for i in (50, 120):
        run.later(i, EcuStage.STEP_ENDED, 8.0)
    run.idle[120, IdleStage.WOKE] = run.idle[120, IdleStage.SCHEDULED] + round(idle_late_ms * MS)
    return run


def test_a_miss_is_the_machines_where_the_idle_loop_was_late_by_the_slack():
    run = judged(Tables(200))
    assert run.counts == {"misses": 0, "misses_ours": 0}
    assert run.verdict == "All 199 commands arrived by their boundary."
    assert run.slack_ns == round(SLACK_MS * MS)
    for late_ms, idle_misses in ((SLACK_MS - 0.01, 0), (SLACK_MS, 1)):
        run = judged(with_two_misses(late_ms))
        assert run.counts == {"misses": 2, "misses_ours": 2 - idle_misses}, late_ms
        assert run.is_too_noisy == ("too noisy for a verdict" in run.verdict) == bool(idle_misses), late_ms
        assert run.verdict.endswith("2 of 199 commands missed their boundary.")
    # Without slack every waking up would count as one that missed.
    slow = Tables(100)
    for i in range(100):
        slow.later(i, EcuStage.PLAN_ENDED, 9.0)
    assert (judged(slow).counts["misses_ours"], judged(slow).idle_misses) == (99, 0)


def test_an_ecu_that_leaves_control_does_not_pass_for_one_that_is_fast():
    """A frame that is lost leaves one period without a plan, a fault all that follow."""
    for lost, left in ((range(50, 51), False), (range(50, 54), False), (range(50, 55), True), (range(80, 199), True)):
        run = Tables(200)
        for i in lost:
            # The ECU answers in time, and plans nothing.
            run.ecu[i, [EcuStage.PLAN_BEGAN, EcuStage.PLAN_ENDED]] = 0
        of_run = judged(run)
        assert (of_run.misses, of_run.without_plan, of_run.left_control) == (0, len(lost), left)
        assert f"{len(lost)} of them have no plan" in of_run.verdict
        assert ("left control: FAULT, IMPLAUSIBLE." in of_run.verdict) == left


def test_the_baseline_is_of_the_same_time_and_of_every_period():
    run = Tables(200)
    run.idle[150:, IdleStage.WOKE] += 15 * MS
    run.vehicle, run.ecu = run.vehicle[:100], run.ecu[:100]
    assert not judged(run).is_too_noisy
    run.idle = run.idle[:0]
    with pytest.raises(StillwakeError, match="idle loop did not run"):
        judged(run)
    # A period that was left out counts until the next waking.
    late = lateness(np.delete(Tables(50).idle, [20, 21], axis=0), PERIOD)
    assert late[19:23].tolist() == [80_000, 80_000 + 2 * PERIOD, 80_000 + PERIOD, 80_000]
    assert len(late) == 50
    # Its own deadlines are whole periods apart, and it never wakes early.
    rows = idle_loop.run(2 * MS, lambda: False, longest=20).rows()
    steps = np.diff(rows[:, IdleStage.SCHEDULED])
    np.testing.assert_array_equal(steps, 2 * MS * np.diff(rows[:, IdleStage.PERIOD]))
    assert (rows[:, IdleStage.WOKE] >= rows[:, IdleStage.SCHEDULED]).all()


def test_figures_are_strict_json_with_every_stage():
    run = with_two_misses(9.0)
    for i in range(195, 200):
        run.lose_command(i)
    figures = json.loads(json.dumps(judged(run).figures(), allow_nan=False))
    assert (figures["periods"], figures["misses"], figures["baseline"]["misses"]) == (199, 2 + 4, 1)
    assert list(figures["stages"]) == [stage.value for stage in Stage]
    assert all(set(row) == {"p50_ms", "p99_ms", "p99_9_ms", "max_ms"} for row in figures["stages"].values())
    assert figures["stages"]["plan"]["max_ms"] == TOOK["plan"]
    assert figures["stages"]["all"]["max_ms"] is None  # some commands never came
    run.lose_command(slice(None))
    assert judged(run).figures()["slack_ms"] is None
    assert "nan" not in " ".join(measured.notes(judged(run)))
    assert "Privileges of the idle loop: memory locked." in measured.notes(judged(run))


@pytest.mark.slow  # draws figures
def test_the_page_begins_with_the_verdict_and_has_its_picture(tmp_path):
    lost = Tables(50)
    for i in range(5, 50):
        lost.lose_command(i)
    runs = [judged(with_two_misses(9.0)), judged(Tables(200), "c"), judged(lost, "lost $_$")]
    budget = {"misses_ours": 0, "plan.max_ms": 9.0}
    measured.write_report(tmp_path, runs, [verdicts(budget, run.counts, run.latencies) for run in runs])
    page = (tmp_path / measured.PAGE).read_text()
    assert page.startswith("onnx: This machine is too noisy")
    for row in ("misses_ours | 0 | 1 | NO", "misses_ours | 0 | 0 | yes", "plan.max_ms | 9 | 8 | yes", "never"):
        assert f"| {row} |" in page, row
    assert "(histogram.png)" in page and (tmp_path / "histogram.png").read_bytes().startswith(b"\x89PNG")
    assert next(measured.stage_rows(runs[1])) == ("sample", "0.30", "0.30", "0.30", "0.30", "")


def budget_of(tmp_path, text):
    path = tmp_path / "budget.toml"
    path.write_text(text)
    return measured.read_budget(path)


def test_each_limit_with_what_was_measured(tmp_path):
    text = "misses_ours = 0\n[plan]\nmax_ms = 10\np50_ms = 5\n[all]\np99_ms = 9.9\np99_9_ms = 9.98"
    taken = {stage: Quantiles.of(np.arange(1.0, 1001.0) * 1e4) for stage in Stage}  # 0.01 to 10 ms
    taken[Stage.GATE] = Quantiles.of(np.array([]))
    judged = verdicts(budget_of(tmp_path, text + "\n[gate]\nmax_ms = 1"), {"misses": 3, "misses_ours": 1}, taken)
    assert judged == [
        KeptLimit("misses_ours", 0, 1),
        KeptLimit("plan.p50_ms", 5.0, 5.0),
        KeptLimit("plan.max_ms", 10.0, 10.0),
        KeptLimit("gate.max_ms", 1.0, None),
        KeptLimit("all.p99_ms", 9.9, 9.9),
        KeptLimit("all.p99_9_ms", 9.98, 9.99),
    ]
    # A stage that did not happen keeps no limit, nor does a command that never came.
    assert [verdict.is_kept for verdict in judged] == [False, True, True, False, True, False]
    assert not KeptLimit("all.max_ms", 1e300, float("inf")).is_kept


def test_a_wrong_file_is_one_line_with_its_name_and_place(tmp_path):
    cases = [
        ("", "has no limit"),
        ("misses_ours", "after a key"),
        ("misses_ours = -1", "misses_ours = -1: must be at least 0"),
        *((f"misses_ours = {value}", "must be a whole number") for value in ("true", "0.5")),
        ("misses_theirs = 0", "misses_theirs is unknown"),
        ("all = 3", "all = 3: must be a table"),
        ("[engine]\np99_ms = 3", "engine is unknown"),
        ("[all]\np95_ms = 3", "all.p95_ms is unknown"),
        *((f"[all]\np99_ms = {value}", "must be a positive number") for value in ("0", "nan", "inf")),
        *((f"[all]\np99_ms = {value}", "must be a number") for value in ("'3'", "{a = 1}")),
    ]
    for text, expected in cases:
        with pytest.raises(ConfigError) as caught:
            budget_of(tmp_path, text)
        message = str(caught.value)
        assert expected in message and "budget.toml" in message and "\n" not in message, (text, message)
