"""Budgets: what they limit, and what is wrong with a file in one line."""

import numpy as np
import pytest

from contract.errors import ConfigError
from firmware_sim.latency.budget import KeptLimit, read_budget, verdicts
from firmware_sim.latency.measured import Quantiles
from firmware_sim.latency.stages import Stage


def budget_of(tmp_path, text):
    path = tmp_path / "budget.toml"
    path.write_text(text)
    return read_budget(path)


def test_each_limit_with_what_was_measured(tmp_path):
    text = "misses_ours = 0\n[plan]\nmax_ms = 10\np50_ms = 5\n[all]\np99_ms = 9.9\np99_9_ms = 9.98"
    measured = {stage: Quantiles.of(np.arange(1.0, 1001.0) * 1e4) for stage in Stage}  # 0.01 to 10 ms
    measured[Stage.GATE] = Quantiles.of(np.array([]))
    judged = verdicts(budget_of(tmp_path, text + "\n[gate]\nmax_ms = 1"), {"misses": 3, "misses_ours": 1}, measured)
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
