"""The feedback: filters folded into one matrix, odd, no action before it has learned."""

import numpy as np
import torch

from contract.controller.goal import OWN, Goal
from export.program.weights import PriorWeights
from export.reference.prior import prior_plan
from tests.train.refinement.oscillator import MIDDLES, feedback_of
from train.refinement.feedback import Feedback, filters

SCALES, LIMIT, MEMORY, SPEEDS = (0.4, 0.15, 0.05), 0.075, 32, (0.6, 1.0, 1.4)
GOALS = (OWN, Goal(0.7, 0.2, 0.5), Goal(0.1, 1.0, 0.0))


def test_every_row_is_read_and_the_newest_by_themselves():
    for memory in (4, 20, 64):
        found = filters(memory).numpy()
        assert (found.sum(axis=1) > 0).all(), memory
        np.testing.assert_allclose(found.sum(axis=0), 1.0)
        newest = 10 if memory == 64 else memory
        np.testing.assert_array_equal(found[::-1][:newest, :newest], np.eye(newest))


def test_a_prior_is_taken_up_again_as_it_was():
    for memory in (MEMORY, 6):
        first, again = feedback_of(memory, scales=SCALES), Feedback(memory, 5, SCALES, MIDDLES, LIMIT, 2)
        again.begin_with(first.as_prior())
        for kept, whole in zip(again.parameters(), first.parameters(), strict=True):
            np.testing.assert_allclose(kept.detach().numpy(), whole.detach().numpy(), atol=1e-12)


def test_the_prior_of_a_program_is_the_feedback_a_period_ahead():
    """From the vehicle's window: its rows hold the action before them, the committed one comes with the plan."""
    rng, feedback = np.random.default_rng(1), feedback_of(MEMORY, scales=SCALES)
    # Differences, sums about their middles, and actions.
    rows = rng.normal(0.0, 0.2, (MEMORY, 5)) * [1.0, 1.0, 1.0, 1.0, 0.3] + [0.0, 0.0, *MIDDLES, 0.0]
    differences, sums = rows[:, :2], rows[:, 2:4]
    window = np.zeros((MEMORY, 5))
    window[:, :4:2], window[:, 1:4:2] = (sums + differences) / 2.0, (sums - differences) / 2.0
    window[1:, 4] = rows[:-1, 4]
    predictor = rng.normal(size=(2, MEMORY, 3))
    committed, free = np.array([rows[-1, 4], 0.0, 0.0]), np.array([0.0, 1.0, 1.0])
    cases = [(speed, goal) for speed in SPEEDS for goal in GOALS]

    def plans(tensors: dict[str, np.ndarray], window=window, committed=committed) -> np.ndarray:
        prior = PriorWeights.from_state({**tensors, "predictor": predictor})
        return np.array([prior_plan(prior, window, committed, free, LIMIT, *case) for case in cases])

    found = plans(feedback.as_prior())
    np.testing.assert_array_equal(found[:, 0], committed[0])
    expected = [feedback(torch.from_numpy(rows), *case).item() for case in cases]
    np.testing.assert_allclose(found[:, 1], expected, rtol=1e-12)
    assert np.ptp(expected) > 0.05 * LIMIT
    # Before it has learned, it does nothing.
    assert Feedback(MEMORY, 5, SCALES, MIDDLES, LIMIT, 0)(torch.from_numpy(rows)).item() == 0.0
    # A mirrored wake gets the mirrored plan.
    image = window[:, [1, 0, 3, 2, 4]] * [1, 1, 1, 1, -1]
    np.testing.assert_allclose(plans(feedback.as_prior(), image, -committed), -found)


def test_a_training_begins_at_a_prior_of_1_0_0_as_the_vehicle_reads_it():
    rng, count = np.random.default_rng(2), filters(MEMORY).shape[1]
    first, slope = rng.normal(0.0, 0.5, (2, 3, count, 3))
    old = {"filters": filters(MEMORY).numpy(), "first": first, "slope": slope, "output": rng.normal(0.0, 1.0, 3)}
    taken, predictor = Feedback(MEMORY, 5, SCALES, MIDDLES, LIMIT, 3), np.zeros((2, MEMORY, 3))
    taken.begin_with(old)
    begun, read = (PriorWeights.from_state({**one, "predictor": predictor}) for one in (taken.as_prior(), old))
    window = rng.normal(-0.5, 0.2, (MEMORY, 5))
    for speed in SPEEDS:
        # Units that the old one lacks have no output yet.
        found, expected = (prior_plan(one, window, np.zeros(2), np.ones(2), LIMIT, speed) for one in (begun, read))
        np.testing.assert_allclose(found, expected, rtol=1e-12)
