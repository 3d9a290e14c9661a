"""Growing modes and undone kicks of responses that are known in closed form."""

import numpy as np
import pytest

from benchmarks.wake.steady_response import late_rate, undone, unstable

DT = 0.2


def test_the_modes_of_a_sum_of_oscillations_are_found():
    t = DT * np.arange(330)
    parts = ((0.155, 0.158, 1.0, 0.3), (0.06, 0.127, 2.0, 1.1), (-0.2, 0.4, 5.0, 0.0))
    waves = [size * np.exp(rate * t) * np.cos(2 * np.pi * f * t + phase) for rate, f, size, phase in parts]
    h = np.stack([sum(waves), waves[0] - 0.5 * waves[1] + 2.0 * waves[2]], axis=1)
    found = unstable(h, 6, DT)
    assert [(mode.growth, mode.frequency) for mode in found] == [
        pytest.approx((0.155, 0.158), abs=1e-4),
        pytest.approx((0.06, 0.127), abs=1e-4),
    ]


@pytest.mark.parametrize("later", [5, 20])
def test_a_growing_disturbance_takes_as_much_more_to_undo_as_it_has_grown(later):
    """h_k = g^k looks the same at all times, so a start later by n steps takes g^n times the actions."""
    growth = 1.04
    h = growth ** np.arange(400.0)[:, None]
    first, then = undone(h, 10, DT), undone(h, 10 + later, DT)
    assert then["action"] == pytest.approx(growth**later * first["action"], rel=0.01)
    assert max(first["left"], then["left"]) < 1e-3


def test_the_late_growth_rate_is_that_of_an_exponential():
    t = DT * np.arange(450)
    assert late_rate(np.exp(0.15 * t)[:, None], DT) == pytest.approx(0.15)
