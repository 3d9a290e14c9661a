"""One rounding for all lowerings: the integers, the scales and the program that they stand for agree.

Calibrated rounding makes smaller errors than rounding to nearest.
"""

import numpy as np
import pytest
from onnx import numpy_helper

from contract.config.learning import ModelConfig
from examples.random_programs import random_program
from export.int8.calibrate import rounded_on
from export.int8.layer_inputs import layer_inputs
from export.int8.rounded_program import rounded_to_nearest
from export.program.controller_program import matrices
from export.program.windows import random_windows
from export.reference.model import decode, encode, step
from export.to_onnx.control_step import build_controller

PROGRAM = random_program(0, model=ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8))


@pytest.fixture(scope="module", params=["nearest", "calibrated"])
def rounded(request):
    return (
        rounded_to_nearest(PROGRAM) if request.param == "nearest" else rounded_on(PROGRAM, random_windows(PROGRAM, 9))
    )


def test_every_matrix_is_rounded_and_stands_for_the_programs(rounded):
    """To a unit in the last place of the scale, 1.2e-7 of a weight."""
    expected = matrices(rounded.program)
    assert rounded.matrices.keys() == expected.keys() == matrices(PROGRAM).keys()
    assert len(expected) == 9 + len(PROGRAM.decoder.blocks)
    for name, matrix in rounded.matrices.items():
        np.testing.assert_allclose(matrix.dequantised(), expected[name], rtol=2.4e-7, err_msg=name)


def test_the_graph_stores_these_integers_and_scales(rounded):
    """The LSTM's rows in ONNX's gate order, i, o, f, c for i, f, g, o; one direction in front."""
    tensors = [numpy_helper.to_array(tensor) for tensor in build_controller(rounded).graph.initializer]
    for name, matrix in rounded.matrices.items():
        values, scales = matrix.values, matrix.scales
        if name.startswith("lstm."):
            order = np.arange(len(scales)).reshape(4, -1)[[0, 3, 1, 2]].ravel()
            values, scales = values[order][None], scales[order]
        for expected in (values, scales):
            same = (expected.dtype == found.dtype and np.array_equal(expected, found) for found in tensors)
            assert any(same), name


@pytest.fixture(scope="module")
def case():
    program = random_program(3)
    rng = np.random.default_rng(5)
    rows = rng.standard_normal((program.window + 60, len(program.sensors) + 1)) * 0.1
    windows = [rows[k : k + program.window] for k in range(60)]
    return program, windows, layer_inputs(program, windows)


def _step_errors(program, other, seen):
    z, a = seen.state[:, :-1], seen.state[:, -1] * program.scaling.action_std
    return step(other, z, a) - step(program, z, a)


@pytest.mark.slow  # a network is calibrated
def test_a_step_and_its_parts_are_closer_than_rounded_to_nearest(case):
    program, windows, seen = case
    nearest, calibrated = rounded_to_nearest(program).program, rounded_on(program, windows).program
    coarse, fine = (np.mean(_step_errors(program, other, seen) ** 2) for other in (nearest, calibrated))
    assert np.sqrt(fine) < 0.5 * np.sqrt(coarse)
    # So are latent states and forces.
    for function, inputs in ((encode, windows), (decode, seen.z[::50])):
        exact, coarse, fed = (np.array([function(of, x) for x in inputs]) for of in (program, nearest, calibrated))
        assert np.sqrt(np.mean((fed - exact) ** 2)) < 0.8 * np.sqrt(np.mean((coarse - exact) ** 2))
