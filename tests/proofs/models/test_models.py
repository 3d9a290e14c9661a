"""Fail-safe and flashing, explored for a second or two; `python -m tests.proofs models` does it to the end."""

import pytest

from tests.proofs.models import proof

pytestmark = pytest.mark.compiler


def test_the_fail_safe_has_no_state_that_is_not_allowed(tmp_path):
    pair = proof.Pair(proof.SETTINGS["as small as can be"], tmp_path)
    assert proof.explored_fail_safe(pair)["states"] > 30
    assert proof.found("fail_safe", proof.SABOTAGE["fail_safe"][1], tmp_path)


def test_the_store_has_no_state_that_is_not_allowed_among_the_first(tmp_path):
    found = proof.explored_flashing(tmp_path, 150)
    assert found["explored"] == 150 < found["states"] and found["second_cuts"] > 100 < found["recoveries"] + 50
    assert proof.found("flashing", proof.SABOTAGE["flashing"][5], tmp_path)
