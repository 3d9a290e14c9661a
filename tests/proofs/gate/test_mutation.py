"""Every mutant of the gate dies; the measurement finds a mistake that tests leave room for."""

from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from contract.errors import StillwakeError
from tests.proofs.gate import mutation

GATE = '''\
"""A gate of one bound."""


def clamp(value: float) -> float:
    """At most 4."""
    return 4.0 if value > 4.0 else value
'''
FULL = """\
from can_bridge.command_gate import clamp


def test_clamp():
    assert [clamp(value) for value in (3.0, 4.5, 9.0)] == [3.0, 4.0, 4.0]
"""
LOOSE = FULL.replace("(3.0, 4.5, 9.0)", "(3.0, 9.0)").replace("[3.0, 4.0, 4.0]", "[3.0, 4.0]")
WRONG = FULL.replace("[3.0, 4.0, 4.0]", "[3.0, 4.0, 5.0]")


def measured(folder: Path, tests: str) -> dict:
    pytest.importorskip("mutmut", reason="comes with stillwake[dev]")
    (folder / "gate.py").write_text(GATE)
    (folder / "test_gate.py").write_text(tests)
    seen: list[tuple[int, int]] = []
    found = mutation.measure(
        gate=folder / "gate.py",
        tests=folder / "test_gate.py",
        progress=lambda done, total: seen.append((done, total)),
    )
    assert seen[-1][1] == found["gate_mutants"]
    assert all(0 <= done <= total for done, total in seen)
    return found


@pytest.mark.slow  # mutmut starts some processes
def test_a_bound_that_no_test_looks_at_survives(tmp_path):
    """`>` and `>=` are the same here: at 4 the bound is the value. No test can tell them apart."""
    loose = measured(tmp_path, LOOSE)
    # The comparison and both bounds at least.
    assert loose["gate_mutants"] >= 3
    equivalent = ["-    return 4.0 if value > 4.0 else value", "+    return 4.0 if value >= 4.0 else value"]
    moved = ["-    return 4.0 if value > 4.0 else value", "+    return 4.0 if value > 5.0 else value"]
    assert sorted(item["change"] for item in loose["gate_survivors"]) == sorted([equivalent, moved])
    assert loose["gate_mutants_survived"] == 2


@pytest.mark.proofs  # a minute of mutmut
def test_every_mutant_of_the_gate_dies():
    pytest.importorskip("mutmut", reason="comes with stillwake[dev]")
    assert mutation.measure()["gate_survivors"] == []


@pytest.mark.slow  # likewise
def test_tests_that_fail_on_the_gate_itself_are_no_measurement(tmp_path):
    with pytest.raises(StillwakeError, match="mutmut ended with status"):
        measured(tmp_path, WRONG)


def test_without_mutmut_it_says_what_to_install(monkeypatch):
    def missing(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(mutation, "version", missing)
    with pytest.raises(StillwakeError, match=r"needs mutmut: pip install 'stillwake\[dev\]'"):
        mutation.measure()
