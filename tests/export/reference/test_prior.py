"""The prior's plan, and what the iterations make of it: nothing at a goal that it knows, the rest of one beyond."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.goal import DEAREST_EFFORT
from contract.controller.interface import ControlStep
from contract.runtime.onnx_session import OnnxController
from examples.random_programs import random_program
from export.program.controller_program import ControllerProgram
from export.program.weights import PriorWeights
from export.program.windows import random_window, random_windows
from export.reference.model import encode
from export.reference.mpc import control_step, predict, starting_plan
from export.reference.prior import prior_plan
from export.to_onnx.control_step import build_controller
from tests.each import each

HORIZON, MEMORY, LIMIT = 6, 24, 0.075
SMALL = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
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
