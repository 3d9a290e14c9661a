"""Layers of the networks and their adjoints, in NumPy float64.

Each acts on the last axis of an array (..., n). An adjoint (vector-Jacobian product) takes the layer's input
and dJ/d(output), and returns dJ/d(input).
"""

import numpy as np

from contract.arrays import Array
from export.program.weights import LAYER_NORM_EPSILON, Linear, Norm


def linear(layer: Linear, x: Array) -> Array:
    """y = W x + b; (..., inputs) -> (..., outputs)."""
    return x @ layer.weight.T + layer.bias


def linear_adjoint(layer: Linear, dy: Array) -> Array:
    """dx = W^T dy; (..., outputs) -> (..., inputs)."""
    return dy @ layer.weight


def elu(x: Array) -> Array:
    """x for x > 0, exp(x) - 1 otherwise."""
    # The minimum keeps exp of large positive values, which are not used, from overflowing.
    return np.where(x > 0, x, np.expm1(np.minimum(x, 0.0)))


def elu_adjoint(x: Array, dy: Array) -> Array:
    """dx = dy for x > 0, exp(x) dy otherwise."""
    return np.asarray(dy * np.exp(np.minimum(x, 0.0)))


def layer_norm(norm: Norm, x: Array) -> Array:
    """y = g xhat + b with xhat = (x - mean x) / sqrt(var x + 1e-5), the variance over n (not n - 1)."""
    normalised, _ = _normalise(x)
    return normalised * norm.weight + norm.bias


def layer_norm_adjoint(norm: Norm, x: Array, dy: Array) -> Array:
    """dx = r (v - mean v - xhat mean(v xhat)) with v = g dy and r = 1 / sqrt(var x + 1e-5)."""
    normalised, inverse_std = _normalise(x)
    v = dy * norm.weight
    along = (v * normalised).mean(axis=-1, keepdims=True)
    return np.asarray(inverse_std * (v - v.mean(axis=-1, keepdims=True) - normalised * along))


def sigmoid(x: Array) -> Array:
    """1 / (1 + exp(-x)), without overflow for large |x|."""
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * x)))


def _normalise(x: Array) -> tuple[Array, Array]:
    # The sums of `mean` and `var` without what these spend on a short vector before they add: a third of the time.
    n = x.shape[-1]
    centred = x - np.add.reduce(x, axis=-1, keepdims=True) / n
    inverse_std = 1.0 / np.sqrt(np.add.reduce(centred * centred, axis=-1, keepdims=True) / n + LAYER_NORM_EPSILON)
    return centred * inverse_std, inverse_std
