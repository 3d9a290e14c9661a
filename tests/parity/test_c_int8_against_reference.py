"""The int8 C library = NumPy reference on the program it stands for, but for the rounding of activations.

Both have the same int8 weights, so what differs is int16 activations and adjoints: steps of 1.5 times the range over
32767, some 5e-5 of the range, which 25 recursions and a decoder raise to some 1e-3 of a force. Adam moves an action by
lr an iteration whatever the gradient's size; where a component is near zero the two may step apart, so plans are
compared by their root mean square, against the way Adam can take an action.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.errors import ExportError
from ecu.in_c.host_library import CController
from examples.random_programs import random_program
from export.gates import control_cases
from export.int8.calibrate import activation_ranges
from export.int8.rounded_program import RoundedProgram, rounded_to_nearest
from export.program.controller_program import ControllerProgram
from export.program.windows import random_window, random_windows
from export.reference.model import encode
from export.reference.mpc import control_step, predict, shift
from export.to_c.int8_arrays import int8_arrays
from export.to_c.library import c_library
from tests.each import each
from tests.examples import examples
from tests.parity.drawn import assert_nothing_is_carried, drawn_program

HORIZON = 8


def in_integers(rounded: RoundedProgram) -> CController:
    """Its library, with ranges of random windows."""
    windows = random_windows(rounded.program, 10, seed=1)
    return CController(c_library(rounded, windows), rounded.program.sizes, flags=("-O0",))


def assert_close(program: ControllerProgram, controller: CController, count: int) -> None:
    errors, forces, gaps = [], [], []
    for case in control_cases(program, count=count):
        expected = control_step(program, *case.arguments)
        found = controller.control_step(*case.arguments)
        errors.append(found.plan - expected.plan)
        # At its own plan: where a gradient is near zero, rounding turns the sign of a step of Adam.
        forces.append(found.forces - predict(program, encode(program, case.window), found.plan))
        gaps.append(found.cost - expected.cost)
    reach = program.mpc.iterations * program.mpc.learning_rate
    assert np.sqrt(np.mean(np.square(errors))) < 0.05 * reach
    assert np.abs(forces).max() < 2e-3
    assert np.abs(gaps).max() < 5e-3


@pytest.fixture(scope="module")
def small() -> tuple[ControllerProgram, CController]:
    model = ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=13, decoder_width=9)
    rounded = rounded_to_nearest(random_program(5, model=model, mpc=MpcConfig(horizon=HORIZON)))
    return rounded.program, in_integers(rounded)


@pytest.mark.compiler  # compiles a library a net
@each("seed", (1, 2))
def test_random_nets_of_odd_sizes(seed):
    program = drawn_program(seed)
    rounded = rounded_to_nearest(program)
    assert_close(rounded.program, in_integers(rounded), 8)


@examples(60)
@given(
    plan=st.lists(st.floats(-0.075, 0.075), min_size=HORIZON, max_size=HORIZON).map(np.array),
    free=st.lists(st.sampled_from([0.0, 1.0]), min_size=HORIZON, max_size=HORIZON).map(np.array),
    weights=st.sampled_from([0.0, 1.0, 1e6, 1e-12]),
    pressure=st.sampled_from([1.0, -30.0, 1e9]),
    seed=st.integers(0, 100),
)
def test_actions_stay_in_bounds_and_committed_ones_stay_put(small, plan, free, weights, pressure, seed):
    """Whatever the pressures (beyond their range they saturate) and however large or small the gradients."""
    program, controller = small
    window = random_window(program, np.random.default_rng(seed)) * pressure
    found = controller.control_step(window, plan, free, weights * np.array(program.mpc.weights.as_tuple())).plan
    committed = free == 0
    assert np.abs(found[~committed]).max(initial=0.0) <= program.action_limit
    np.testing.assert_array_equal(found[committed], shift(plan).astype(np.float32)[committed])


@pytest.mark.proofs  # compiles six libraries; the shipped one is held to the reference as it is built
@pytest.mark.compiler  # compiles every variant
@each("dynamics_width", [3, 13, 70])
def test_avx2_computes_what_plain_c_does(dynamics_width):
    """Integers, and floats in the same order, so to the bit."""
    processor = Path("/proc/cpuinfo")
    if not (processor.exists() and " avx2 " in processor.read_text()):
        pytest.skip("this processor has no AVX2")
    model = ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=dynamics_width, decoder_width=9)
    rounded = rounded_to_nearest(random_program(7, model=model, mpc=MpcConfig(horizon=HORIZON)))
    program = rounded.program
    windows = random_windows(program, 1, seed=1)
    uncontracted = ("-O1", "-ffp-contract=off")
    plain, native = (
        CController(c_library(rounded, windows), program.sizes, flags=flags)
        for flags in (uncontracted, (*uncontracted, "-march=native"))
    )
    for case in control_cases(program, count=4):
        expected = plain.control_step(*case.arguments)
        found = native.control_step(*case.arguments)
        np.testing.assert_array_equal(found.plan, expected.plan)
        np.testing.assert_array_equal(found.forces, expected.forces)


def test_nothing_is_carried_from_step_to_step_and_no_scratch_is_read(small):
    assert_nothing_is_carried(*small)


def test_what_the_integers_cannot_hold_is_refused():
    model = ModelConfig(window=2, latent=2, lstm_width=3)
    cases: tuple[tuple[int, dict[str, float], str], ...] = (
        (256, {"dynamics.output.weight": 7.0}, r"ELU outputs reach 7, must stay below 6\.4"),
        (256, {"lstm.weight_input": 1e12}, r"LSTM's gates reach .*e\+1\d, must stay below 6e\+04"),
        (517, {}, "a layer of width 517 after an ELU: int8 lowering accepts at most 516"),
    )
    for width, change, message in cases:
        rounded = rounded_to_nearest(random_program(5, model=replace(model, dynamics_width=width)))
        ranges = activation_ranges(rounded.program, random_windows(rounded.program, 1))
        with pytest.raises(ExportError, match=message):
            int8_arrays(rounded, ranges | change)
    with pytest.raises(ExportError, match="no windows"):
        activation_ranges(random_program(0), [])
