"""Properties of the control step that hold whatever the networks are (tests/parity has the bounds of the actions). The
prior's plan, and what the iterations make of it: nothing at a goal that it knows, the rest of one beyond."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes
from scipy.optimize import minimize

from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.goal import DEAREST_EFFORT
from contract.controller.interface import TERMS, ControlStep
from contract.runtime.onnx_session import OnnxController
from examples.random_programs import random_program
from export.program.controller_program import ControllerProgram, random_window, random_windows
from export.program.weights import PriorWeights
from export.reference import mpc as reference
from export.reference.model import encode, encoder_layers, layer_norm
from export.reference.mpc import control_step, cost_terms, evaluate, gradient, optimise, predict, starting_plan
from export.reference.prior import prior_plan
from export.to_onnx.control_step import build_controller
from tests.each import each
from tests.examples import examples

SMALL = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
HORIZON = 6


def small(seed: int = 0, **mpc: Any) -> ControllerProgram:
    return random_program(seed, model=SMALL, mpc=MpcConfig(horizon=HORIZON, **mpc))


@pytest.mark.slow
def test_many_iterations_reach_the_optimum_of_an_independent_optimiser():
    """On smooth terms, against SciPy's L-BFGS-B with numerical gradients of the cost alone."""
    goal = CostWeights(drag_fluctuation=0.0, lift=0.0, lift_mean=0.3, smoothness=4.0, effort=0.5, rate=1.0)
    program = small(iterations=400, learning_rate=2e-3, weights=goal)
    z, weights = encode(program, random_windows(program, 1)[0]), np.array(goal.as_tuple())

    def cost(plan: np.ndarray) -> float:
        return evaluate(program, z, plan, 0.01, weights).cost

    start, limit = np.zeros(HORIZON), program.action_limit
    best = minimize(cost, start, method="L-BFGS-B", bounds=[(-limit, limit)] * HORIZON)
    found = cost(optimise(program, z, start, 0.01, np.ones(HORIZON), weights))
    assert found - best.fun <= 1e-3 * (cost(start) - best.fun) + 1e-9


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


# A matrix product of many rows adds up in another order than that of one: 1e-15 a product, 1e-13 after a roll-out.
CLOSE: dict[str, Any] = {"rtol": 1e-12, "atol": 1e-13}


@examples(8)
@given(shape=array_shapes(min_dims=0, max_dims=3, max_side=3), seed=st.integers(0, 5))
def test_every_function_acts_on_the_last_axes(shape, seed):
    """Many at once are one after the other, whatever the leading axes."""
    program, rng = small(seed), np.random.default_rng(seed)
    z, plan = rng.normal(size=(*shape, 3)), rng.uniform(-0.07, 0.07, (*shape, HORIZON))
    before, weights = rng.uniform(-0.05, 0.05, shape), rng.uniform(0.1, 2.0, 8)
    windows = np.array([random_window(program, rng) for _ in range(int(np.prod(shape)))]).reshape(*shape, 5, -1)
    encoded = encode(program, windows)
    latents = reference.rollout(program, z, plan)
    forces = predict(program, z, plan)
    cost = cost_terms(forces, plan, before, program.mpc.drag_reference) @ weights
    slope = gradient(program, z, plan, before, weights)
    assert encoded.shape == z.shape
    assert latents.shape == (*shape, HORIZON + 1, 3)
    assert forces.shape == (*shape, HORIZON, 2)
    assert cost.shape == shape
    assert slope.shape == plan.shape
    for i in np.ndindex(shape):
        one = (program, z[i], plan[i], float(before[i]))
        np.testing.assert_allclose(encoded[i], encode(program, windows[i]), **CLOSE)
        np.testing.assert_allclose(latents[i], reference.rollout(*one[:3]), **CLOSE)
        np.testing.assert_allclose(forces[i], evaluate(*one, weights).forces, **CLOSE)
        np.testing.assert_allclose(cost[i], evaluate(*one, weights).cost, **CLOSE)
        np.testing.assert_allclose(slope[i], gradient(*one, weights), **CLOSE)


def test_the_lstm_starts_at_zero_and_takes_one_row_at_a_time():
    program = small(3)
    window = random_window(program, np.random.default_rng(3))
    recurrent = encoder_layers(program, window).recurrent
    assert not recurrent[0].any()
    for k in range(1, len(window)):
        head = layer_norm(program.encoder.norm, recurrent[k])
        np.testing.assert_array_equal(head, encoder_layers(program, window[:k]).head)


MEMORY, LIMIT = 24, 0.075
DRAG = CostWeights(drag_fluctuation=0.0, lift=0.0, smoothness=0.0)


def program(**mpc: float) -> ControllerProgram:
    settings = MpcConfig(**{"horizon": HORIZON, **mpc})  # type: ignore[arg-type]
    return random_program(3, model=SMALL, mpc=settings, action_limit=LIMIT, prior_memory=MEMORY)


@each("name", ["slope", "hidden"])
def test_a_prior_of_1_0_0_gives_the_plan_that_its_formula_gives(name):
    """a = limit tanh(output . tanh((first + (speed - 1) slope) . filters^T past)), its predictor on the rows."""
    rng = np.random.default_rng(0)
    filters = np.eye(MEMORY) if name == "hidden" else rng.normal(0.0, 0.3, (MEMORY, 7))
    first, slope = rng.normal(0.0, 0.5, (2, 4, filters.shape[1], 3))
    output, predictor = rng.normal(0.0, 1.0, 4), rng.normal(0.0, 0.1, (2, MEMORY, 3))
    layers = {"hidden": first} if name == "hidden" else {"filters": filters, "first": first, "slope": slope}
    prior = PriorWeights.from_state({**layers, "output": output, "predictor": predictor})
    window, speed = random_window(program(), rng), 1.0 if name == "hidden" else 1.3
    rows = [[row[0] - row[1], row[2] - row[3], later[4]] for row, later in pairwise(window[-MEMORY:])]
    rows, y, expected = [rows[0], *rows], window[-1, [0, 2]] - window[-1, [1, 3]], []
    for _ in range(HORIZON):
        units = np.tanh([(each_unit * (filters.T @ rows)).sum() for each_unit in first + (speed - 1.0) * slope])
        expected.append(LIMIT * np.tanh(output @ units))
        rows = [*rows[1:], [*y, expected[-1]]]
        y = np.array([(each_y * rows).sum() for each_y in predictor])
    found = prior_plan(prior, window, np.zeros(HORIZON), np.ones(HORIZON), LIMIT, speed)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@each("lowering", ["reference", "ONNX"])
def test_at_any_goal_that_the_prior_knows_the_plan_is_the_priors_to_the_bit(lowering):
    goals = [
        DRAG,
        replace(DRAG, lift=1.0),
        replace(DRAG, drag_mean=0.5, effort=0.5 * DEAREST_EFFORT, lift=0.3, prior=2.0),
        replace(DRAG, drag_mean=0.5, effort=9.0 * DEAREST_EFFORT, lift=4.0),
    ]
    few, many = (program(iterations=count, learning_rate=0.01) for count in (1, 9))
    graphs = [build_controller(one).SerializeToString() for one in (few, many)]
    lowered: list[Callable[..., ControlStep]] = [OnnxController(graph, few.sizes).control_step for graph in graphs]
    answers = lowered if lowering == "ONNX" else [partial(control_step, one) for one in (few, many)]
    plans = []
    for window, goal in zip(random_windows(few, len(goals)), goals, strict=True):
        given = window, np.zeros(HORIZON), np.ones(HORIZON), np.array(goal.as_tuple()), 1.2, 0.05
        one, nine = (answer(*given) for answer in answers)
        np.testing.assert_array_equal(one.plan, nine.plan)
        if lowering == "reference":
            np.testing.assert_array_equal(one.plan, starting_plan(few, *given))
        # Terms and cost are still those of the given weights.
        assert abs(one.terms @ given[3] - one.cost) < 1e-5 and one.cost != 0.0
        plans.append(one.plan)
    assert np.abs(plans[0]).max() > 0.005


@each("knows_goal", [True, False])
def test_the_plan_moves_against_the_slope_of_the_terms_that_the_prior_does_not_know(knows_goal):
    """Adam's first step is -lr sign(g), here of a cost written out: of effort and lift too if the prior knows drag
    alone."""
    one = program(iterations=1, learning_rate=1e-6)
    if not knows_goal:
        assert one.prior is not None
        first, gate, goals = one.prior.first.copy(), one.prior.gate.copy(), slice(3, 5)
        first[goals], gate[:, goals] = 0.0, 0.0
        one = replace(one, prior=replace(one.prior, first=first, gate=gate))
    goal = np.array(replace(DRAG, drag_mean=2.0, effort=9.0 * DEAREST_EFFORT, lift=3.0, smoothness=70.0).as_tuple())
    for window in random_windows(one, 5):
        given, z = (window, np.zeros(HORIZON), np.ones(HORIZON), goal), encode(one, window)

        def unknown(plan: np.ndarray, z: np.ndarray = z) -> float:
            smoothness = 70.0 * (np.diff(plan) ** 2).mean()
            if knows_goal:
                return float(smoothness)
            lift = predict(one, z, plan)[:, 1]
            return float(smoothness + 9.0 * DEAREST_EFFORT * (plan**2).mean() + 3.0 * np.abs(lift).mean())

        start, steps = starting_plan(one, *given), 1e-7 * np.eye(HORIZON)
        slope = [unknown(start + step) - unknown(start - step) for step in steps]
        moved = control_step(one, *given).plan - start
        np.testing.assert_allclose(moved, -1e-6 * np.sign(slope), rtol=0.01)
