"""The feedback: filters folded into one matrix, odd, no action before it has learned."""

import numpy as np
import pytest
import torch

from export.program.weights import PriorWeights
from export.reference.prior import prior_plan
from train.refinement.feedback import Feedback, filters

SCALES, LIMIT, MEMORY, SPEEDS = (0.4, 0.15, 0.05), 0.075, 32, (0.6, 1.0, 1.4)


@pytest.fixture
def feedback() -> Feedback:
    made = Feedback(MEMORY, 5, SCALES, LIMIT, 0)
    for layer in (made.output, made.slope):
        torch.nn.init.normal_(layer, 0.0, 0.5, generator=torch.Generator().manual_seed(1))
    return made


def test_every_row_is_read_and_the_newest_by_themselves():
    for memory in (4, 20, 64):
        found = filters(memory).numpy()
        assert (found.sum(axis=1) > 0).all(), memory
        np.testing.assert_allclose(found.sum(axis=0), 1.0)
        newest = 10 if memory == 64 else memory
        np.testing.assert_array_equal(found[::-1][:newest, :newest], np.eye(newest))


def test_before_it_learns_it_does_nothing_and_then_it_is_odd(feedback):
    rows = torch.from_numpy(np.random.default_rng(0).normal(0.0, 0.2, (MEMORY, 3)))
    assert Feedback(MEMORY, 5, SCALES, LIMIT, 0)(rows).item() == 0.0
    action = feedback(rows).item()
    assert 0.0 < abs(action) < LIMIT
    assert feedback(-rows).item() == pytest.approx(-action, rel=1e-12)


def test_a_prior_is_taken_up_again_as_it_was():
    for memory in (MEMORY, 6):
        first = Feedback(memory, 5, SCALES, LIMIT, 1)
        for layer in (first.output, first.slope):
            torch.nn.init.normal_(layer, 0.0, 0.5, generator=torch.Generator().manual_seed(1))
        again = Feedback(memory, 5, SCALES, LIMIT, 2)
        again.begin_with(first.as_prior())
        for kept, whole in zip(again.parameters(), first.parameters(), strict=True):
            np.testing.assert_allclose(kept.detach().numpy(), whole.detach().numpy(), atol=1e-12)


def test_the_prior_of_a_program_is_the_feedback_a_period_ahead(feedback):
    """From the vehicle's window: its rows hold the action before them, the committed one comes with the plan."""
    rng = np.random.default_rng(1)
    rows = rng.normal(0.0, 0.2, (MEMORY, 3))
    window = np.zeros((MEMORY, 5))
    window[:, [0, 2]] = rows[:, :2] + 0.3
    window[:, [1, 3]] = 0.3
    window[1:, 4] = rows[:-1, 2]
    predictor = rng.normal(size=(2, MEMORY, 3))
    committed, free = np.array([rows[-1, 2], 0.0, 0.0]), np.array([0.0, 1.0, 1.0])

    def plans(tensors: dict[str, np.ndarray], window=window, committed=committed) -> np.ndarray:
        prior = PriorWeights.from_state({**tensors, "predictor": predictor})
        return np.array([prior_plan(prior, window, committed, free, LIMIT, speed) for speed in SPEEDS])

    found = plans(feedback.as_prior())
    np.testing.assert_array_equal(found[:, 0], committed[0])
    by_speed = [feedback(torch.from_numpy(rows), speed).item() for speed in SPEEDS]
    np.testing.assert_allclose(found[:, 1], by_speed, rtol=1e-12)
    assert np.ptp(by_speed) > 0.05 * LIMIT
    # A mirrored wake gets the mirrored plan.
    image = window[:, [1, 0, 3, 2, 4]] * [1, 1, 1, 1, -1]
    np.testing.assert_allclose(plans(feedback.as_prior(), image, -committed), -found)
    # An older prior has filters, scales and units in one tensor, which does not know the speed.
    first = feedback.first.detach().numpy().reshape(-1, 3, 5)
    hidden = np.einsum("mf,fcu->umc", filters(MEMORY).numpy(), first) / SCALES
    old = {"hidden": hidden, "output": feedback.output.detach().numpy()}
    np.testing.assert_allclose(plans(old), [found[SPEEDS.index(1.0)]] * len(SPEEDS), rtol=1e-12)
    taken = Feedback(MEMORY, 5, SCALES, LIMIT, 3)
    taken.begin_with(old)
    np.testing.assert_allclose(taken.first.detach(), feedback.first.detach(), atol=1e-12)
    assert not taken.slope.any()
