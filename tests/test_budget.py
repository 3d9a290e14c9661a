"""What tests cost is shown and fails nobody's run, unless the budget is held."""

import sys
from types import SimpleNamespace
from typing import Any

import pytest

from tests import measured
from tests.budget import MOST_TESTS, Budget


def test_a_slow_machine_turns_no_good_run_red(monkeypatch, capsys):
    slow, good, bad = ["--wall-s", "0"], [sys.executable, "-Sc", ""], ["false"]
    for words, status, line in (
        (
            [*slow, *good],
            0,
            "ALL PASSED. It took longer than planned (0 s by the clock are the budget",
        ),
        (["--hold", *slow, *good], 1, "OVER BUDGET, all passed: 0 s by the clock are the budget on"),
        (["--hold", *good], 0, ""),
        ([*slow, *bad], 1, ""),
    ):
        monkeypatch.setattr(sys, "argv", ["measured.py", *words])
        assert measured.main() == status, words
        assert line in capsys.readouterr().err, words


@pytest.mark.parametrize(("asked", "costs", "count", "fails"), [
    ("shown", [(99.0, 0.5, "a")], 1, False),
    ("held", [(99.0, 0.5, "a")], 1, True),
    ("held", [(1.0, 0.5, "a")], 1, False),
    ("shown", [], MOST_TESTS + 1, True),
])  # fmt: skip
def test_a_test_over_its_budget_fails_where_that_is_held(asked, costs, count, fails):
    config: Any = SimpleNamespace(getoption=lambda _: asked)
    budget, session = Budget(config), SimpleNamespace(exitstatus=pytest.ExitCode.OK, items=range(count))
    budget.pytest_collection_finish(session)  # type: ignore[arg-type]
    budget.pytest_testnodedown(SimpleNamespace(workeroutput={"costs": costs}))
    budget.pytest_sessionfinish(session)  # type: ignore[arg-type]
    assert (session.exitstatus == pytest.ExitCode.TESTS_FAILED) == fails
