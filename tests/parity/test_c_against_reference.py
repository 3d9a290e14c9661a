"""Third link of the chain: the C library, compiled here = NumPy reference.

In float32, tolerances are those of the ONNX float graph, for the same reasons (`export.gates`): both compute in
float32. In int8, both have the same weights, so what differs is int16 activations and adjoints: steps of 1.5 times the
range over 32767, some 5e-5 of the range, which 25 recursions and a decoder raise to some 1e-3 of a force. Adam moves an
action by lr an iteration whatever the gradient's size; where a component is near zero the two may step apart, so plans
are compared by their root mean square, against the way Adam can take an action.
"""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.goal import DEAREST_EFFORT
from contract.controller.interface import ControllerError
from contract.errors import ExportError
from ecu.in_c.host_library import CController
from examples.random_programs import random_program
from export.gates import check_lowering, control_cases
from export.int8 import RoundedProgram, activation_ranges, rounded_to_nearest
from export.program.controller_program import ControllerProgram, random_window, random_windows
from export.reference.model import encode
from export.reference.mpc import control_step, predict, shift
from export.to_c.int8_arrays import int8_arrays
from export.to_c.library import c_library, int8_library
from tests.each import each
from tests.examples import examples
from tests.parity.drawn import drawn_program
from tests.refused import refused

SMALL = ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=12, decoder_width=8)
ODD = ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=13, decoder_width=9)
HORIZON = 8
FAST_BUILD = ("-O0",)


def in_c(program: ControllerProgram) -> CController:
    return CController(c_library(program), program.sizes, flags=FAST_BUILD)


def in_integers(rounded: RoundedProgram, flags: tuple[str, ...] = FAST_BUILD) -> CController:
    windows = random_windows(rounded.program, 10, seed=1)
    return CController(c_library(rounded, windows), rounded.program.sizes, flags=flags)


@pytest.fixture(scope="module", params=[pytest.param("float32", marks=pytest.mark.slow), "int8"])
def small(request) -> tuple[ControllerProgram, CController]:
    program = random_program(5, model=ODD, mpc=MpcConfig(horizon=HORIZON))
    if request.param == "float32":
        return program, in_c(program)
    rounded = rounded_to_nearest(program)
    return rounded.program, in_integers(rounded)


@pytest.mark.slow
@each("seed", (1, 2))
def test_random_nets_of_odd_sizes(seed):
    program = drawn_program(seed)
    check_lowering(program, in_c(program), "C library", random_windows(program, 8, seed=seed))


@pytest.mark.compiler  # compiles a library a net
@each("seed", (1, 2))
def test_random_nets_of_odd_sizes_in_integers(seed):
    rounded = rounded_to_nearest(drawn_program(seed))
    program, controller, errors, forces, gaps = rounded.program, in_integers(rounded), [], [], []
    for case in control_cases(program, count=8):
        expected = control_step(program, *case)
        found = controller.control_step(*case)
        errors.append(found.plan - expected.plan)
        # At its own plan: where a gradient is near zero, rounding turns the sign of a step of Adam.
        forces.append(found.forces - predict(program, encode(program, case.window), found.plan))
        gaps.append(found.cost - expected.cost)
    reach = program.mpc.iterations * program.mpc.learning_rate
    assert np.sqrt(np.mean(np.square(errors))) < 0.05 * reach
    assert np.abs(forces).max() < 2e-3
    assert np.abs(gaps).max() < 5e-3


@pytest.mark.slow
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
    scale=st.sampled_from([0.0, 1.0, 1e6, 1e-12]),
    pressure=st.sampled_from([1.0, -30.0, 1e9]),
    limit=st.floats(0.0, 0.125, width=32),
    seed=st.integers(0, 100),
)
def test_actions_stay_in_bounds_and_committed_ones_stay_put(small, plan, free, scale, pressure, limit, seed):
    """Whatever the pressures (beyond their range integers saturate) and however large or small the gradients."""
    program, controller = small
    window, weights = random_window(program, np.random.default_rng(seed)), np.array(program.mpc.weights.as_tuple())
    found = controller.control_step(pressure * window, plan, free, scale * weights, limit=limit).plan
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


@pytest.mark.slow
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
    program, controller = small
    cases = list(control_cases(program, count=4))
    first = [controller.control_step(*case) for case in cases]
    for case, expected in zip(reversed(cases), reversed(first), strict=True):
        controller._workspace[:] = 0xFF  # NaN, to show that no result depends on what it held before
        found = controller.control_step(*case)
        for name in ("plan", "forces", "cost"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


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


@pytest.mark.proofs  # compiles six libraries; the shipped one is held to the reference as it is built
@pytest.mark.compiler  # compiles every variant
@each("dynamics_width", [3, 13, 70])
def test_avx2_computes_what_plain_c_does(dynamics_width):
    """Integers, and floats in the same order, so to the bit."""
    processor = Path("/proc/cpuinfo")
    if not (processor.exists() and " avx2 " in processor.read_text()):
        pytest.skip("this processor has no AVX2")
    model = replace(ODD, dynamics_width=dynamics_width)
    rounded = rounded_to_nearest(random_program(7, model=model, mpc=MpcConfig(horizon=HORIZON)))
    uncontracted = ("-O1", "-ffp-contract=off")
    plain, native = (in_integers(rounded, flags) for flags in (uncontracted, (*uncontracted, "-march=native")))
    for case in control_cases(rounded.program, count=4):
        expected = plain.control_step(*case)
        found = native.control_step(*case)
        np.testing.assert_array_equal(found.plan, expected.plan)
        np.testing.assert_array_equal(found.forces, expected.forces)


def test_what_the_integers_cannot_hold_is_refused():
    model = ModelConfig(window=2, latent=2, lstm_width=3)
    cases: tuple[tuple[int, dict[str, float], str], ...] = (
        (256, {"dynamics.output.weight": 7.0}, r"ELU outputs reach 7; the limit is 6\.4"),
        (256, {"lstm.weight_input": 1e12}, r"LSTM's gates reach .*e\+1\d; the limit is 6e\+04"),
        (517, {}, "a layer after an ELU has the width 517; the int8 library accepts at most 516"),
    )
    for width, change, message in cases:
        rounded = rounded_to_nearest(random_program(5, model=replace(model, dynamics_width=width)))
        ranges = activation_ranges(rounded.program, random_windows(rounded.program, 1))
        with pytest.raises(ExportError, match=message):
            int8_arrays(rounded, ranges | change)
