"""The judged run: counts, figures and first line, from made-up tables whose misses are known."""

import json

import numpy as np
import pytest

from contract.errors import StillwakeError
from firmware_sim.ecu.real_time.stage_times import EcuStage
from firmware_sim.latency.budget import Budget, verdicts
from firmware_sim.latency.cyclictest import Cyclictest
from firmware_sim.latency.idle_loop import IdleStage
from firmware_sim.latency.measured import Measured
from firmware_sim.latency.report import PAGE, stage_rows, write_report
from firmware_sim.latency.running import Recorded
from firmware_sim.latency.stages import Stage
from tests.firmware_sim.latency.conftest import COUNTERS, MS, PERIOD, TOOK, Tables

SLACK_MS = 20.0 - sum(TOOK.values())
CYCLIC = Cyclictest(priority=50, count=201, min_ms=0.024, mean_ms=0.045, max_ms=0.889)


def judged(run: Tables, name: str = "onnx", cyclictest: Cyclictest | None = None) -> Measured:
    recorded = Recorded(
        vehicle=run.vehicle, ecu=run.ecu, idle=run.idle, cyclictest=cyclictest, privileges="memory locked"
    )
    return Measured.of(recorded, name=name, about="a release", period_ns=PERIOD, counter_period=COUNTERS)


def with_two_misses(tables) -> Tables:
    """Two late commands, and an idle loop that was late in the second one's period."""
    run: Tables = tables(200)
    for i in (50, 120):
        run.later(i, EcuStage.STEP_ENDED, 8.0)
    run.idle[120, IdleStage.WOKE] += 9 * MS
    return run


def test_an_undisturbed_run(tables):
    run = judged(tables(200))
    assert run.counts == {"misses": 0, "misses_ours": 0}
    assert run.verdict == "All 199 commands came by the boundary they were due at."
    assert not run.is_too_noisy
    assert run.slack_ns == round(SLACK_MS * MS)
    assert run.latencies[Stage.PLAN].max == TOOK["plan"]
    assert np.median(run.idle_late) == 80_000


def test_an_idle_loop_that_was_late_by_the_slack_shows_the_machine(tables):
    for late_ms, idle_misses in ((SLACK_MS - 0.01, 0), (SLACK_MS, 1)):
        run = with_two_misses(tables)
        run.idle[120, IdleStage.WOKE] = run.idle[120, IdleStage.SCHEDULED] + round(late_ms * MS)
        found = judged(run)
        assert found.counts == {"misses": 2, "misses_ours": 2 - idle_misses}, late_ms
        assert found.is_too_noisy is bool(idle_misses)
        assert found.verdict.endswith("2 of 199 commands missed their boundary.")
        assert ("too noisy for a verdict" in found.verdict) is bool(idle_misses)
    # Another time's idle loop shows nothing, and none at all is no baseline.
    run = tables(200)
    run.idle[150:, IdleStage.WOKE] += 15 * MS
    run.vehicle, run.ecu = run.vehicle[:100], run.ecu[:100]
    assert not judged(run).is_too_noisy
    run.idle = run.idle[:0]
    with pytest.raises(StillwakeError, match="idle loop did not run"):
        judged(run)


def test_a_loop_slower_than_its_period_makes_no_machine_noisy(tables):
    run = tables(100)
    for i in range(100):
        run.later(i, EcuStage.PLAN_ENDED, 9.0)
    found = judged(run)
    # Without slack every waking up would count as one that missed.
    assert (found.counts["misses_ours"], found.idle_misses) == (99, 0)
    assert found.verdict.startswith("99 of 99 commands")
    assert np.isfinite(found.figures()["slack_ms"])


def test_figures_are_strict_json_with_every_stage(tables):
    run = with_two_misses(tables)
    for i in range(195, 200):
        run.lose_command(i)
    again = json.loads(json.dumps(judged(run).figures(), allow_nan=False))
    assert again["periods"] == 199
    assert again["misses"] == 2 + 4
    assert list(again["stages"]) == [stage.value for stage in Stage]
    for row in again["stages"].values():
        assert set(row) == {"p50_ms", "p99_ms", "p99_9_ms", "max_ms"}
    # Commands that never came have no finite lateness.
    assert again["stages"]["all"]["max_ms"] is None
    assert again["baseline"]["misses"] == 1


@pytest.mark.slow  # draws figures
def test_the_page_begins_with_the_verdict_and_has_its_pictures(tables, tmp_path):
    lost = tables(50)
    for i in range(5, 50):
        lost.lose_command(i)
    runs = [judged(with_two_misses(tables)), judged(tables(200), "c", CYCLIC), judged(lost, "lost")]
    budget = Budget(counts={"misses_ours": 0}, latencies={(Stage.PLAN, "max_ms"): 9.0})
    write_report(tmp_path, runs, [verdicts(budget, run.counts, run.latencies) for run in runs])
    page = (tmp_path / PAGE).read_text()
    assert page.startswith("onnx: This machine is too noisy")
    for row in ("misses_ours | 0 | 1 | NO", "misses_ours | 0 | 0 | yes", "plan.max_ms | 9 | 8 | yes", "never"):
        assert f"| {row} |" in page, row
    for name in ("histogram.png", "timeline_onnx.png", "timeline_c.png", "timeline_lost.png"):
        assert f"({name})" in page
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    rows = list(stage_rows(runs[1]))
    assert rows[0] == ("sample", "0.30", "0.30", "0.30", "0.30", "")
    assert rows[-1] == ("cyclictest (mean 0.04)", "", "", "", "0.89", "")
    assert rows[-2][0].startswith("idle loop")
