"""Int8 weights: error at most half a step of each row, and an effective program that shows what was kept."""

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
from export.gates.quantisation import QuantisationLimits, check_quantisation, compare_answers, exact_answers
from export.int8.nearest import quantise_matrix
from export.int8.rounded_program import rounded_to_nearest
from export.program.random_windows import random_window
from export.reference.mpc import control_step

SMALL = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
matrices = arrays(np.float64, array_shapes(min_dims=2, max_dims=2, max_side=6), elements=st.floats(-1e6, 1e6, width=32))


@given(weight=matrices)
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
    assert (same.max_plan_error, same.max_cost_gap, same.cases) == (0.0, 0.0, 5)
    rounded = partial(control_step, rounded_to_nearest(program).program)
    report = compare_answers(program, rounded, windows, exact)
    assert 0 < report.rms_action_error <= report.max_action_error <= report.max_plan_error
    assert report.mean_cost_gap <= report.max_cost_gap
    check_quantisation(report, QuantisationLimits(rms_action_error=1.0, max_cost_gap=1.0))
    with pytest.raises(ExportError, match="rms_action_error"):
        check_quantisation(report, QuantisationLimits(rms_action_error=1e-12, max_cost_gap=1.0))
    with pytest.raises(ExportError, match="max_cost_gap"):
        check_quantisation(report, QuantisationLimits(rms_action_error=1.0, max_cost_gap=-1.0))
    with pytest.raises(ExportError, match="no windows"):
        compare_answers(program, rounded, [], [])
