"""A short run of both ECUs through random periods; `python -m tests.proofs ecu_c` has a million."""

import pytest

from tests.proofs.ecu_in_c import campaign


@pytest.mark.compiler
def test_both_answer_alike_to_forged_repeated_and_damaged_frames(tmp_path):
    name = "authenticated, at all speeds"
    found = campaign.stretch(campaign.build(name, tmp_path), name, "0", 400)
    assert found.mismatch is None, found.mismatch
    assert found.modes.keys() >= {"CONTROL", "HOLD", "FAULT"}
