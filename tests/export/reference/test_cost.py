"""Cost terms against their definitions worked by hand."""

import numpy as np
import pytest

from contract.config.controller import CostWeights
from contract.controller.interface import TERMS
from export.reference.cost import cost_terms


def test_terms_of_a_small_example_by_hand():
    forces = np.array([[1.0, -0.4], [1.2, 0.2], [1.1, 0.5]])
    plan = np.array([0.02, 0.05, 0.01])
    start = np.array([0.02, 0.02, 0.02])
    terms = dict(zip(TERMS, cost_terms(forces, plan, 0.05, 1.051, start), strict=True))
    assert terms == pytest.approx(
        {
            "drag_mean": 1.1 - 1.051,
            "drag_fluctuation": 0.2,
            "lift": 1.1 / 3,
            "lift_mean": 0.1**2,
            "smoothness": (0.03**2 + 0.04**2) / 2,
            "effort": (0.02**2 + 0.05**2 + 0.01**2) / 3,
            "rate": 0.03**2,
            "prior": (0.03**2 + 0.01**2) / 3,
        }
    )
    # Terms have the order of the weights.
    named = CostWeights(**{name: float(i) for i, name in enumerate(TERMS)})
    assert named.as_tuple() == tuple(range(8))
