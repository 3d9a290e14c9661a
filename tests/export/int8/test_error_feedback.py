"""Error feedback against what it promises: nearest rounding where inputs are independent, better products elsewhere."""

import numpy as np

from export.int8.error_feedback import DAMPING, quantise_on
from export.int8.nearest import quantise_matrix


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
        fed, nearest = (
            error(weight, of, inputs).sum() for of in (quantise_on(weight, inputs), quantise_matrix(weight))
        )
        assert fed < 0.3 * nearest, seed
    # Rounding again changes nothing.
    rng = np.random.default_rng(3)
    weight, inputs = rng.standard_normal((16, 40)), correlated(rng, 500, 40)
    fed = quantise_on(weight, inputs)
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
