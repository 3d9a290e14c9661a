"""Roads from a shifted plan: against the control step, finite differences, and a cost whose minimum is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.controller.operations.chosen import chosen_roads
from benchmarks.controller.operations.road import Blocked, Newton, Problem, Road, adam, heavy_ball, lift_slopes
from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.c_folder import Settings
from export.program.random_program import random_program
from export.reference.mpc import optimise, predict
from export.to_c.library import c_library

SMALL = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
HORIZON = 6
GOAL = CostWeights(lift=0.05, lift_mean=0.3, smoothness=4.0, effort=0.5, rate=1.0)
SMOOTH = CostWeights(drag_mean=0.0, drag_fluctuation=0.0, lift=0.0, smoothness=4.0, effort=0.5, rate=1.0)


def problem(weights=GOAL, committed=1, n=3):
    program = random_program(0, model=SMALL, mpc=MpcConfig(horizon=HORIZON, iterations=3, weights=weights))
    rng = np.random.default_rng(0)
    return Problem(
        program=program,
        z=rng.normal(size=(n, 3)),
        start=rng.uniform(-0.05, 0.05, (n, HORIZON)),
        previous_action=rng.uniform(-0.05, 0.05, n),
        free=np.arange(HORIZON) >= committed,
        weights=np.array(weights.as_tuple()),
    )


def road(rule, **settings):
    return Road(name="one", rule=rule, **{"rate": 1e-3, "iterations": 3, **settings})


def all_roads():
    start = SimpleNamespace(multiply_accumulates=7)
    return [replace(one, proposal=None) for one in chosen_roads(np.zeros((2, HORIZON, HORIZON)), start)]


def test_adam_is_the_control_steps_optimiser():
    one = problem()
    found, _ = road(adam, rate=one.program.mpc.learning_rate).plan(one)
    expected = optimise(one.program, one.z, one.start, one.previous_action, one.free.astype(float))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-15)


def test_as_many_blocks_as_actions_are_adam():
    one = problem()
    np.testing.assert_array_equal(road(Blocked(HORIZON - 1)).plan(one)[0], road(adam).plan(one)[0])


def test_a_block_moves_as_one():
    one = problem(committed=2)
    moved = road(Blocked(2)).plan(one)[0] - one.start
    assert (moved[:, :2] == 0.0).all()
    np.testing.assert_allclose(np.ptp(moved[:, 2:4], axis=1), 0.0, atol=1e-15)
    np.testing.assert_allclose(np.ptp(moved[:, 4:], axis=1), 0.0, atol=1e-15)
    assert (moved[:, 2:] != 0.0).all()


@pytest.mark.parametrize("one", all_roads(), ids=lambda one: f"{one.name} {one.iterations}")
def test_no_road_moves_what_is_committed_or_leaves_the_limit(one):
    given = problem(committed=2)
    found, _ = replace(one, rate=1e3 * one.rate).plan(given)
    np.testing.assert_array_equal(found[:, :2], given.start[:, :2])
    assert np.abs(found).max() <= given.program.action_limit


def test_slopes_of_the_lift_are_those_of_finite_differences():
    one, step = problem(), 1e-6
    for k in range(HORIZON):
        plus, minus = (predict(one.program, one.z, one.start + sign * step * np.eye(HORIZON)[k]) for sign in (1, -1))
        np.testing.assert_allclose(
            lift_slopes(one, one.start)[:, :, k], (plus - minus)[..., 1] / (2.0 * step), rtol=1e-5, atol=1e-7
        )


def test_a_newton_step_ends_a_quadratic_cost():
    """Of the smooth terms alone B is the whole Hessian, so that one step is the minimum and a second moves nothing."""
    given = problem(weights=SMOOTH)
    once, _ = road(Newton(0.0, "none"), rate=1.0, iterations=1).plan(given)
    twice, _ = road(Newton(0.0, "none"), rate=1.0, iterations=2).plan(given)
    np.testing.assert_allclose(once, twice, atol=1e-14)
    for nudge in (1e-3, -1e-3):
        assert (given.cost(once + nudge * given.free) > given.cost(once)).all()


def test_what_is_kept_is_shifted_with_the_plan():
    given = problem()
    _, memory = road(heavy_ball, carried=True, iterations=1).plan(given)
    _, (velocity,) = road(heavy_ball, carried=True, iterations=1).plan(given, memory)
    fresh = memory[0]
    np.testing.assert_allclose(velocity[:, :-1] - fresh[:, :-1], 0.9 * fresh[:, 1:], atol=1e-15)


def test_a_proposal_is_taken_where_it_costs_less():
    given = problem()
    best, _ = road(adam, iterations=200).plan(given)
    proposed = np.where(np.arange(3)[:, None] == 1, best, given.program.action_limit)
    plans, _ = road(adam, iterations=0, proposal=lambda _: proposed).plan(given)
    np.testing.assert_array_equal(plans[1], best[1])
    np.testing.assert_array_equal(plans[[0, 2]], given.start[[0, 2]])


def test_products_are_counted_as_the_c_librarys():
    program = problem().program
    assert road(adam).multiply_accumulates(program) == Settings.of(c_library(program)).multiply_accumulates()
