"""Third link of the chain: the C library, compiled here = NumPy reference.

Tolerances are those of the ONNX float graph, for the same reasons (`export.gates`): both compute in float32.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.goal import DEAREST_EFFORT
from contract.controller.interface import ControllerError
from ecu.in_c.host_library import CController
from examples.random_programs import random_program
from export.gates import check_lowering, control_cases
from export.program.controller_program import ControllerProgram
from export.program.windows import random_window, random_windows
from export.reference.mpc import shift
from export.to_c.library import c_library, int8_library
from tests.each import each
from tests.examples import examples
from tests.parity.drawn import assert_nothing_is_carried, drawn_program
from tests.refused import refused

pytestmark = pytest.mark.slow  # a library is compiled for each size

SMALL = ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=12, decoder_width=8)
HORIZON = 8
FAST_BUILD = ("-O0",)


def in_c(program: ControllerProgram) -> CController:
    return CController(c_library(program), program.sizes, flags=FAST_BUILD)


@pytest.fixture(scope="module")
def small() -> tuple[ControllerProgram, CController]:
    program = random_program(5, model=SMALL, mpc=MpcConfig(horizon=HORIZON))
    return program, in_c(program)


@each("seed", (1, 2))
def test_random_nets_of_odd_sizes(seed):
    program = drawn_program(seed)
    check_lowering(program, in_c(program), "C library", random_windows(program, 8, seed=seed))


def test_equal_forces_share_the_subgradient():
    """With the decoder's output switched off every Cd ties and every Cl is 0: the kinks of all terms at once."""
    program = random_program(3, model=SMALL, mpc=MpcConfig(horizon=HORIZON))
    output = program.decoder.output
    still = replace(output, weight=0 * output.weight, bias=0 * output.bias)
    program = replace(program, decoder=replace(program.decoder, output=still))
    check_lowering(program, in_c(program), "C library", random_windows(program, 20))


@examples(60)
@given(
    plan=st.lists(st.floats(-0.075, 0.075), min_size=HORIZON, max_size=HORIZON).map(np.array),
    free=st.lists(st.sampled_from([0.0, 1.0]), min_size=HORIZON, max_size=HORIZON).map(np.array),
    scale=st.sampled_from([0.0, 1.0, 1e3, 1e9]),
    limit=st.floats(0.0, 0.125, width=32),
    seed=st.integers(0, 100),
)
def test_actions_stay_in_bounds_and_committed_ones_stay_put(small, plan, free, scale, limit, seed):
    program, controller = small
    window, weights = random_window(program, np.random.default_rng(seed)), np.array(program.mpc.weights.as_tuple())
    found = controller.control_step(window, plan, free, scale * weights, limit=limit).plan
    committed = free == 0
    assert np.abs(found[~committed]).max(initial=0.0) <= min(limit, program.action_limit)
    np.testing.assert_array_equal(found[committed], shift(plan).astype(np.float32)[committed])


SKIPS, ALWAYS = b"? SW_ITERATIONS : 0;", b">= 0 ? SW_ITERATIONS : 0;"
MOVES, MOVES_OTHERWISE = b"const float moved = ", b"const float moved = 0.001f + "
GOALS = (
    (0, CostWeights(lift=0.0)),
    (0, CostWeights(drag_mean=2.0, lift=1.9, effort=1.5 * DEAREST_EFFORT)),
    (0, CostWeights(drag_mean=0.5, lift=0.5, effort=3.0)),
    (0, CostWeights(effort=4.0 * DEAREST_EFFORT, lift=4.0)),
    (1, CostWeights(lift_mean=1.0)),
    (1, CostWeights(rate=1e-3)),
)
"""Whether the iterations have something to do."""


def test_iterations_that_nothing_asks_for_are_left_out_and_would_change_no_bit():
    """As they are, but with a wrong step of Adam, beside iterations that always run."""
    program = random_program(5, model=SMALL, mpc=MpcConfig(horizon=HORIZON), prior_memory=24)
    sources = int8_library(program, random_windows(program, 10))
    step = sources["sw_control_step.c"]
    assert step.count(SKIPS) == step.count(MOVES) == 1
    skipping, iterating = (
        CController(sources | {"sw_control_step.c": step.replace(*change)}, program.sizes, flags=FAST_BUILD)
        for change in ((MOVES, MOVES_OTHERWISE), (SKIPS, ALWAYS))
    )
    for case, (is_asked, goal) in product(control_cases(program, count=5), GOALS):
        weights = np.array(replace(goal, drag_fluctuation=0.0, smoothness=0.0).as_tuple())
        found, expected = (
            one.control_step(case.window, case.plan, case.free, weights, case.speed, case.limit)
            for one in (skipping, iterating)
        )
        assert np.array_equal(found.plan, expected.plan) == (not is_asked), goal
        assert is_asked or (found.cost, found.terms.tolist()) == (expected.cost, expected.terms.tolist())


def test_nothing_is_carried_from_step_to_step_and_no_scratch_is_read(small):
    assert_nothing_is_carried(*small)


def test_a_number_that_is_not_finite_is_reported(small):
    program, controller = small
    (case,) = control_cases(program, count=1)
    sound = {"window": case.window, "plan": case.plan, "weights": program.mpc.weights.as_tuple()}
    sound |= {"speed": 1.0, "limit": 0.05}
    for where, value in product(sound, (np.nan, np.inf)):
        broken = np.array(sound[where])
        broken[(-1,) * broken.ndim] = value
        with refused(ControllerError, "a number is not finite"):
            controller.control_step(free=case.free, **sound | {where: broken})
    controller.control_step(case.window, case.plan, case.free)
