"""Every mutant of the gate dies; the measurement finds a mistake that tests leave room for."""

import pytest

from contract.errors import StillwakeError
from tests.proofs.gate import mutation

GATE = """\
def clamp(value: float) -> float:
    return 4.0 if value > 4.0 else value
"""
LOOSE = """\
from can_bridge.command_gate import clamp


def test_clamp():
    assert [clamp(value) for value in (3.0, 9.0)] == [3.0, 4.0]
"""


@pytest.mark.proofs  # mutmut starts some processes
def test_a_bound_that_no_test_looks_at_survives(tmp_path):
    """`>` and `>=` are the same here: at 4 the bound is the value. No test can tell them apart."""
    gate, tests = tmp_path / "gate.py", tmp_path / "test_gate.py"
    gate.write_text(GATE)
    tests.write_text(LOOSE)
    loose = mutation.measure(gate=gate, tests=tests)
    # The comparison and both bounds at least.
    assert loose["gate_mutants"] >= 3
    old = "-    return 4.0 if value > 4.0 else value"
    equivalent, moved = "+    return 4.0 if value >= 4.0 else value", "+    return 4.0 if value > 5.0 else value"
    assert sorted(item["change"] for item in loose["gate_survivors"]) == sorted([[old, equivalent], [old, moved]])
    # Tests that fail on the gate itself are no measurement.
    tests.write_text(LOOSE.replace("[3.0, 4.0]", "[3.0, 5.0]"))
    with pytest.raises(StillwakeError, match="mutmut run ended with status"):
        mutation.measure(gate=gate, tests=tests)


@pytest.mark.proofs  # a minute of mutmut
def test_every_mutant_of_the_gate_dies():
    assert mutation.measure()["gate_survivors"] == []
