"""What tests cost is shown and fails nobody's run, unless the budget is held."""

import sys
from types import SimpleNamespace
from typing import Any

import pytest

from tests import measured
from tests.budget import MOST_TESTS, Budget


def test_a_slow_machine_turns_no_good_run_red(monkeypatch, capsys):
    slow, good = ["--wall-s", "0"], [sys.executable, "-Sc", ""]
    for words, status, line in (
        ([*slow, *good], 0, "ALL PASSED. It took longer than planned (0 s by the clock are the budget"),
        (["--hold", *slow, *good], 1, "OVER BUDGET, all passed: 0 s by the clock are the budget on"),
        (["--hold", *good], 0, ""),
        ([*slow, "false"], 1, ""),
    ):
        monkeypatch.setattr(sys, "argv", ["measured.py", *words])
        assert measured.main() == status, words
        assert line in capsys.readouterr().err, words
    for asked, cost_s, count, status in (
        ("shown", 99.0, 1, pytest.ExitCode.OK),
        ("held", 99.0, 1, pytest.ExitCode.TESTS_FAILED),
        ("held", 1.0, 1, pytest.ExitCode.OK),
        ("shown", 1.0, MOST_TESTS + 1, pytest.ExitCode.TESTS_FAILED),
    ):
        config: Any = SimpleNamespace(getoption=lambda _, asked=asked: asked)
        budget, session = Budget(config), SimpleNamespace(exitstatus=pytest.ExitCode.OK)
        budget.pytest_testnodedown(SimpleNamespace(workeroutput={"costs": [(cost_s, 0.5, "a")], "count": count}))
        budget.pytest_sessionfinish(session)  # type: ignore[arg-type]
        assert session.exitstatus == status, (asked, cost_s, count)
