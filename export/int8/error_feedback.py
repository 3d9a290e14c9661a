"""Rounding a matrix to int8 so that its products, not its weights, stay close: error feedback column by column.

Nearest rounding makes the least of every weight's error. What counts is |(W - W_q) X|^2 over the inputs X that a layer
meets, and inputs are correlated: what one column's rounding does to an output can be taken back by the columns still to
come. With H = X^T X / n + damping, and U the upper Cholesky factor of its inverse, H^-1 = U^T U, rounding column j by e
changes every later column k by -e U_jk / U_jj: the best that they can do (optimal brain surgeon; Frantar et al.,
"GPTQ", ICLR 2023).

The scales are `quantise_matrix`'s, and the largest weight of a row, which sets its scale, keeps its integer: rounding
the result again changes no integer.
"""

from typing import Final

import numpy as np

from contract.arrays import Array
from export.int8.nearest import QMAX, Int8Matrix, quantise_matrix

DAMPING: Final = 0.01
"""Share of H's mean diagonal that is added to it: directions that the inputs never take must not be given away."""


def quantise_on(weight: Array, inputs: Array) -> Int8Matrix:
    """The Int8Matrix of a matrix (outputs, m) whose products with inputs (n, m) are close to its own."""
    nearest = quantise_matrix(weight)
    scales = nearest.scales.astype(np.float64)
    covariance = inputs.T @ inputs / len(inputs)
    # Inputs that are all zero call for no rounding in particular.
    damping = DAMPING * covariance.trace() / len(covariance) or 1.0
    inverse = np.linalg.inv(covariance + damping * np.eye(len(covariance)))
    upper = np.linalg.cholesky(inverse).T

    rest = weight.copy()
    steps = np.zeros_like(weight)
    largest = np.abs(weight).argmax(axis=1)
    for j in range(weight.shape[1]):
        rounded = np.clip(np.rint(rest[:, j] / scales), -QMAX, QMAX)
        steps[:, j] = np.where(largest == j, nearest.values[:, j], rounded)
        error = (rest[:, j] - steps[:, j] * scales) / upper[j, j]
        rest[:, j + 1 :] -= np.outer(error, upper[j, j + 1 :])
    return Int8Matrix(values=steps.astype(np.int8), scales=nearest.scales)
