"""Calibrated rounding against what it promises: errors smaller than those of rounding to nearest."""

import numpy as np
import pytest

from export.int8.calibrate import rounded_on
from export.int8.layer_inputs import layer_inputs
from export.int8.rounded_program import rounded_to_nearest
from export.program.random_program import random_program
from export.reference.layers import elu, layer_norm, linear
from export.reference.model import decode, encode, encoder_layers, step

pytestmark = pytest.mark.slow  # a network is calibrated


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


def test_inputs_are_those_of_the_reference(case):
    """Layer by layer through the same formulas, so equal to rounding."""
    program, windows, seen = case
    encoded = np.array([encode(program, window) for window in windows])
    np.testing.assert_allclose(linear(program.encoder.output, seen.latent), encoded, atol=1e-12)
    plans = len(seen.state) // (program.mpc.horizon * len(windows))
    np.testing.assert_allclose(seen.state[: plans * len(windows) : plans, :-1], encoded, atol=1e-12)
    after = step(program, seen.state[:, :-1], seen.state[:, -1] * program.scaling.action_std)
    np.testing.assert_allclose(after, seen.z, atol=1e-12)
    np.testing.assert_allclose(linear(program.dynamics.output, seen.hidden2), seen.z - seen.state[:, :-1], atol=1e-12)
    normed = layer_norm(program.dynamics.norm_hidden, linear(program.dynamics.hidden, seen.hidden1))
    np.testing.assert_allclose(elu(normed), seen.hidden2, atol=1e-12)
    for before, added, after in zip(seen.blocks, seen.elus, [*seen.blocks[1:], seen.forces], strict=True):
        np.testing.assert_allclose(before + added, after, atol=1e-12)
    # Before the first row of a window there is nothing; before the last, what a window without that row ends with.
    count = len(windows)
    assert not seen.recurrent[:count].any()
    np.testing.assert_allclose(seen.recurrent[-1], encoder_layers(program, windows[-1][:-1]).output, atol=1e-12)
    scaled = linear(program.decoder.output, seen.forces)
    forces = scaled * program.scaling.force_std + program.scaling.force_mean
    np.testing.assert_allclose(forces, decode(program, seen.z), atol=1e-12)


def test_a_step_and_its_parts_are_closer_than_rounded_to_nearest(case):
    program, windows, seen = case
    nearest, calibrated = (
        np.sqrt(np.mean(_step_errors(program, other, seen) ** 2))
        for other in (rounded_to_nearest(program).program, rounded_on(program, windows).program)
    )
    assert calibrated < 0.5 * nearest
    # So are latent states and forces.
    program, windows, seen = case
    nearest, calibrated = rounded_to_nearest(program).program, rounded_on(program, windows).program
    for function, inputs in ((encode, windows), (decode, seen.z[::50])):
        exact, coarse, fed = (np.array([function(of, x) for x in inputs]) for of in (program, nearest, calibrated))
        assert np.sqrt(np.mean((fed - exact) ** 2)) < 0.8 * np.sqrt(np.mean((coarse - exact) ** 2))
