"""Calibrated rounding against what it promises: errors smaller than those of rounding to nearest."""

import numpy as np
import pytest

from examples.random_programs import random_program
from export.int8.calibrate import rounded_on
from export.int8.layer_inputs import layer_inputs
from export.int8.rounded_program import rounded_to_nearest
from export.reference.model import decode, encode, step

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


def test_a_step_and_its_parts_are_closer_than_rounded_to_nearest(case):
    program, windows, seen = case
    nearest, calibrated = rounded_to_nearest(program).program, rounded_on(program, windows).program
    coarse, fine = (np.mean(_step_errors(program, other, seen) ** 2) for other in (nearest, calibrated))
    assert np.sqrt(fine) < 0.5 * np.sqrt(coarse)
    # So are latent states and forces.
    for function, inputs in ((encode, windows), (decode, seen.z[::50])):
        exact, coarse, fed = (np.array([function(of, x) for x in inputs]) for of in (program, nearest, calibrated))
        assert np.sqrt(np.mean((fed - exact) ** 2)) < 0.8 * np.sqrt(np.mean((coarse - exact) ** 2))
