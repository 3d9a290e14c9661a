"""Correcting biases against what it promises: no mean error, and a shorter way from the float roll-out."""

import numpy as np
import pytest

from export.calibrate import correct_biases
from export.quantise import quantise
from export.random_program import random_program
from export.reference_model import encode, step


@pytest.fixture(scope="module")
def case():
    program = random_program(3)
    rng = np.random.default_rng(5)
    rows = rng.standard_normal((program.window + 60, len(program.sensors) + 1)) * 0.1
    windows = [rows[k : k + program.window] for k in range(60)]
    rounded = quantise(program)
    return program, rounded, correct_biases(program, rounded, windows), windows


def _step_errors(program, other, windows):
    z = np.array([encode(program, window) for window in windows[:-1]])
    a = np.array([window[-1, -1] for window in windows[1:]])
    return step(other, z, a) - step(program, z, a)


def test_the_mean_error_of_a_step_nearly_vanishes(case):
    program, rounded, corrected, windows = case
    before = np.abs(_step_errors(program, rounded, windows).mean(axis=0)).max()
    after = np.abs(_step_errors(program, corrected, windows).mean(axis=0)).max()
    # Each layer is corrected on the float program's inputs; what is left comes from the layers before it.
    assert after < 0.3 * before


def test_only_the_dynamics_biases_change(case):
    _, rounded, corrected, _ = case
    assert corrected.encoder is rounded.encoder and corrected.decoder is rounded.decoder
    for name in ("input", "hidden", "output"):
        ours, theirs = getattr(corrected.dynamics, name), getattr(rounded.dynamics, name)
        assert np.array_equal(ours.weight, theirs.weight)
        assert not np.array_equal(ours.bias, theirs.bias)


def test_an_unrounded_program_is_left_as_it_is(case):
    program, _, _, windows = case
    same = correct_biases(program, program, windows)
    assert np.array_equal(same.dynamics.hidden.bias, program.dynamics.hidden.bias)


def test_rounding_again_changes_nothing(case):
    _, _, corrected, _ = case
    again = quantise(corrected)
    for name in ("input", "hidden", "output"):
        np.testing.assert_allclose(
            getattr(again.dynamics, name).weight, getattr(corrected.dynamics, name).weight, rtol=1e-6
        )
