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


def test_each_limit_with_what_was_measured(tmp_path):
    budget = budget_of(
        tmp_path, "misses_ours = 0\n[all]\np99_ms = 9.9\np99_9_ms = 9.98\n[plan]\nmax_ms = 10\np50_ms = 5"
    )
    found = verdicts(budget, {"misses": 3, "misses_ours": 1}, MEASURED)
    assert found == [
        Verdict("misses_ours", 0, 1),
        Verdict("all.p99_ms", 9.9, 9.9),
        Verdict("all.p99_9_ms", 9.98, 9.99),
        Verdict("plan.max_ms", 10.0, 10.0),
        Verdict("plan.p50_ms", 5.0, 5.0),
    ]
    assert [verdict.is_kept for verdict in found] == [False, True, False, True, True]


def test_a_stage_that_did_not_happen_and_a_command_that_never_came_keep_no_budget():
    assert not Verdict("plan.p99_ms", 9.0, None).is_kept
    assert not Verdict("all.max_ms", 1e300, float("inf")).is_kept


def test_a_wrong_file_is_one_line(tmp_path):
    cases = [
        ("", "limits nothing"),
        ("misses_ours", "not TOML"),
        *((f"misses_ours = {value}", "whole number") for value in ("-1", "true", "0.5")),
        ("misses_theirs = 0", "'misses_theirs' cannot be limited"),
        ("all = 3", "'all' cannot be limited"),
        ("[engine]\np99_ms = 3", "'engine' cannot be limited"),
        ("[all]\np95_ms = 3", "all.p95_ms is not known"),
        ("[all]\np99_ms = 0", "all.p99_ms = 0: must be a number of ms, positive"),
        *((f"[all]\np99_ms = {value}", "must be a number") for value in ("nan", "inf", "'3'", "{a = 1}", "9" * 400)),
        ("misses = " + "9" * 5000, "not TOML"),
        ("# " + "x" * 70_000, "more than"),
    ]
    for text, expected in cases:
        with pytest.raises(ConfigError) as caught:
            budget_of(tmp_path, text)
        message = str(caught.value)
        assert expected in message and "budget.toml" in message, text[:40]
        assert "\n" not in message and len(message) < 400, text[:40]
    with pytest.raises(ConfigError, match="No such file"):
        read_budget(tmp_path / "none.toml")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match="not TOML"):
        read_budget(tmp_path / "b.toml")
