"""A weight of the cost changes in the closed loop what it is called after: on the coarse mesh, through bus and ECU.

More weight on lift does not show there in single runs (docs/explanation/through-the-flow.md), in the model's forecasts
it does (`tests/test_shipped_artefacts.py`).
"""

import pytest

from benchmarks.release.weights import outcome


@pytest.mark.proofs  # a minute of the flow
def test_more_weight_on_effort_spares_the_jets():
    little, much = (outcome("effort", value)["rms_action"] for value in (0.0, 100.0))
    assert much < 0.93 * little
