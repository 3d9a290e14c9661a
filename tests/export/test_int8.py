"""Int8 weights: error at most half a step of each row; with error feedback, products that are several times closer."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.errors import ExportError
from examples.random_programs import random_program
from export.gates import check_quantisation, compare_answers, exact_answers
from export.int8 import DAMPING, layer_inputs, quantise_matrix, quantise_on, rounded_on, rounded_to_nearest
from export.program.controller_program import random_window
from export.reference.model import decode, encode, step
from export.reference.mpc import control_step


@pytest.fixture(scope="module")
def case():
    program = random_program(3, model=ModelConfig(lstm_width=32, dynamics_width=96, decoder_width=48))
    rng = np.random.default_rng(5)
    rows = rng.standard_normal((program.window + 60, len(program.sensors) + 1)) * 0.1
    windows = [rows[k : k + program.window] for k in range(60)]
    return program, windows, layer_inputs(program, windows)


def _step_errors(program, other, seen):
    state = seen["dynamics.input.weight"]
    z, a = state[:, :-1], state[:, -1] * program.scaling.action_std
    return step(other, z, a) - step(program, z, a)


@pytest.mark.slow  # a network is calibrated
def test_a_step_and_its_parts_are_closer_than_rounded_to_nearest(case):
    program, windows, seen = case
    nearest, calibrated = rounded_to_nearest(program).program, rounded_on(program, windows).program
    coarse, fine = (np.mean(_step_errors(program, other, seen) ** 2) for other in (nearest, calibrated))
    assert np.sqrt(fine) < 0.5 * np.sqrt(coarse)
    # So are latent states and forces.
    for function, inputs in ((encode, windows), (decode, seen["decoder.input.weight"][::50])):
        exact, coarse, fed = (np.array([function(of, x) for x in inputs]) for of in (program, nearest, calibrated))
        assert np.sqrt(np.mean((fed - exact) ** 2)) < 0.8 * np.sqrt(np.mean((coarse - exact) ** 2))


SMALL = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
MATRICES = arrays(np.float64, array_shapes(min_dims=2, max_dims=2, max_side=6), elements=st.floats(-1e6, 1e6, width=32))


@given(weight=MATRICES)
def test_no_weight_moves_by_more_than_half_a_step(weight):
    found = quantise_matrix(weight)
    assert found.values.dtype == np.int8 and found.scales.dtype == np.float32
    assert (found.scales > 0).all() and np.abs(found.values.astype(int)).max() <= 127
    # A little over half: the scale itself and the product are rounded to float32.
    half_step = found.scales[:, None] * 0.5 + 2e-7 * np.abs(weight)
    assert (np.abs(found.dequantised() - weight) <= half_step).all()


def test_each_row_has_its_own_scale_and_its_largest_weight_is_kept():
    weight = np.array([[1.0, -0.5], [0.001, 0.0004], [0.0, 0.0]])
    found = quantise_matrix(weight)
    np.testing.assert_array_equal(found.values, [[127, -64], [127, 51], [0, 0]])
    np.testing.assert_allclose(found.scales, [1 / 127, 0.001 / 127, 1.0], rtol=1e-6)


def test_the_gate_names_the_figure_that_is_too_large():
    program = random_program(1, model=SMALL, mpc=MpcConfig(horizon=6))
    rng = np.random.default_rng(0)
    windows = [random_window(program, rng) for _ in range(5)]
    exact = exact_answers(program, windows)
    same = compare_answers(program, partial(control_step, program), windows, exact)
    assert (same["max_plan_error"], same["max_cost_gap"], same["cases"]) == (0.0, 0.0, 5)
    rounded = partial(control_step, rounded_to_nearest(program).program)
    report = compare_answers(program, rounded, windows, exact)
    assert 0 < report["rms_action_error"] <= report["max_action_error"] <= report["max_plan_error"]
    assert report["mean_cost_gap"] <= report["max_cost_gap"]
    check_quantisation(report, {"rms_action_error": 1.0, "max_cost_gap": 1.0})
    with pytest.raises(ExportError, match="rms_action_error"):
        check_quantisation(report, {"rms_action_error": 1e-12, "max_cost_gap": 1.0})
    with pytest.raises(ExportError, match="max_cost_gap"):
        check_quantisation(report, {"rms_action_error": 1.0, "max_cost_gap": -1.0})
    with pytest.raises(ExportError, match="no windows"):
        compare_answers(program, rounded, [], [])


def error(weight, matrix, inputs):
    return np.sum(((weight - matrix.dequantised().astype(float)) @ inputs.T) ** 2, axis=1)


def damped(error, h):
    return np.einsum("ri,ij,rj->r", error, h, error)


def correlated(rng, count, width):
    """A few directions carry nearly everything, as in a hidden layer."""
    return rng.standard_normal((count, 3)) @ rng.standard_normal((3, width)) + 0.05 * rng.standard_normal(
        (count, width)
    )


def test_independent_inputs_leave_nearest_rounding():
    """With H a multiple of the identity no later column can take an error back."""
    weight = np.random.default_rng(0).standard_normal((7, 5))
    weight[3] = 0.0
    inputs = np.sqrt(5.0) * np.eye(5)
    for rows in (inputs, np.zeros((9, 5))):
        np.testing.assert_array_equal(quantise_on(weight, rows).values, quantise_matrix(weight).values)


def test_products_are_several_times_closer_and_rounding_again_changes_nothing():
    for seed in range(4):
        rng = np.random.default_rng(seed)
        weight, inputs = rng.standard_normal((16, 40)), correlated(rng, 500, 40)
        fed = quantise_on(weight, inputs)
        assert error(weight, fed, inputs).sum() < 0.3 * error(weight, quantise_matrix(weight), inputs).sum(), seed
        again = quantise_matrix(fed.dequantised().astype(float))
        np.testing.assert_array_equal(again.values, fed.values)
        np.testing.assert_allclose(again.scales, fed.scales, rtol=1e-6)


def test_the_last_column_is_the_best_there_is():
    """Nothing comes after it, so of all integers its one makes the least error, given the others: H by hand."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        weight, inputs = rng.standard_normal((50, 6)), correlated(rng, 300, 6)
        weight[:, 0] = 4.0  # the column that sets the scales
        found = quantise_on(weight, inputs)
        h = inputs.T @ inputs / len(inputs)
        h += DAMPING * np.trace(h) / 6 * np.eye(6)
        left = weight - found.dequantised()
        for change in (-1.0, 1.0):
            other = left - change * np.eye(6)[-1] * found.scales[:, None]
            assert np.all(damped(left, h) <= damped(other, h) * (1 + 1e-9)), seed
