"""Budgets: what they limit, and what is wrong with a file in one line."""

import numpy as np
import pytest

from contract.errors import ConfigError
from firmware_sim.latency.budget import Verdict, read_budget, verdicts
from firmware_sim.latency.quantiles import Quantiles
from firmware_sim.latency.stages import Stage


def budget_of(tmp_path, text):
    path = tmp_path / "budget.toml"
    path.write_text(text)
    return read_budget(path)


MEASURED = {stage: Quantiles.of(np.arange(1.0, 1001.0) * 1e4) for stage in Stage}
"""0.01 to 10 ms."""


def test_each_limit_beside_what_was_measured(tmp_path):
    budget = budget_of(
        tmp_path, "misses_ours = 0\n[all]\np99_ms = 9.9\np99_9_ms = 9.98\n[plan]\nmax_ms = 10\np50_ms = 5"
    )
    found = verdicts(budget, {"misses": 3, "misses_ours": 1, "misses_unexplained": 1}, MEASURED)
    assert found == [
        Verdict("misses_ours", 0, 1),
        Verdict("all.p99_ms", 9.9, 9.9),
        Verdict("all.p99_9_ms", 9.98, 9.99),
        Verdict("plan.max_ms", 10.0, 10.0),
        Verdict("plan.p50_ms", 5.0, 5.0),
    ]
    assert [verdict.is_kept for verdict in found] == [False, True, False, True, True]


def test_a_stage_that_did_not_happen_keeps_no_budget():
    assert not Verdict("plan.p99_ms", 9.0, None).is_kept


def test_a_command_that_never_came_keeps_none():
    assert not Verdict("all.max_ms", 1e300, float("inf")).is_kept


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "limits nothing"),
        ("misses_ours", "not TOML"),
        ("misses_ours = -1", "whole number"),
        ("misses_ours = true", "whole number"),
        ("misses_ours = 0.5", "whole number"),
        ("misses_theirs = 0", "'misses_theirs' cannot be limited"),
        ("all = 3", "'all' cannot be limited"),
        ("[engine]\np99_ms = 3", "'engine' cannot be limited"),
        ("[all]\np95_ms = 3", "all.p95_ms is not known"),
        ("[all]\np99_ms = 0", "all.p99_ms = 0: must be a number of ms, positive"),
        ("[all]\np99_ms = nan", "must be a number"),
        ("[all]\np99_ms = inf", "must be a number"),
        ("[all]\np99_ms = '3'", "must be a number"),
        ("[all]\np99_ms = {a = 1}", "must be a number"),
        ("[all]\np99_ms = " + "9" * 400, "must be a number"),
        ("misses = " + "9" * 5000, "not TOML"),
        ("# " + "x" * 70_000, "more than"),
    ],
)
def test_a_wrong_file_is_one_line(tmp_path, text, says):
    with pytest.raises(ConfigError) as caught:
        budget_of(tmp_path, text)
    assert says in str(caught.value)
    assert "budget.toml" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_a_missing_file_and_one_that_is_no_text(tmp_path):
    with pytest.raises(ConfigError, match="No such file"):
        read_budget(tmp_path / "none.toml")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match="not TOML"):
        read_budget(tmp_path / "b.toml")
    with pytest.raises(ConfigError, match="directory"):
        read_budget(tmp_path)
