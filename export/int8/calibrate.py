"""The rounding of matrices with error feedback on each layer's recorded inputs (`quantise_on`, `layer_inputs`).

Biases are not corrected by the mean of the remaining error, because after error feedback this would gain nothing.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from contract.arrays import Array
from export.int8.layer_inputs import LayerInputs, layer_inputs
from export.int8.rounded_program import QMAX, Int8Matrix, RoundedProgram, quantise_matrix
from export.program.controller_program import ControllerProgram

DAMPING: Final = 0.01
"""Share of the mean diagonal entry of H (`quantise_on`) that is added to H's diagonal. So errors also count in
directions in which the inputs do not vary."""


def quantise_on(weight: Array, inputs: Array) -> Int8Matrix:
    """Round a matrix (outputs, m) to an Int8Matrix, so that its products with n inputs (n, m) change little.

    Nearest rounding minimises the error of each weight alone. But the error that counts is |(W - W_q) X|^2, and inputs
    are correlated: later columns can compensate the effect of one column's rounding on an output. Let H = X^T X / n +
    damping, with the upper Cholesky factor U of H^-1 = U^T U. If rounding changes column j by e, each later column k
    changes by -e U_jk / U_jj, the best compensation (optimal brain surgeon; Frantar et al., "GPTQ", ICLR 2023).

    The scales are as in `quantise_matrix`. The largest weight of a row determines the row's scale and is rounded to the
    nearest integer. So rounding the result a second time changes no integer.
    """
    nearest = quantise_matrix(weight)
    scales = nearest.scales.astype(np.float64)
    covariance = inputs.T @ inputs / len(inputs)
    # If all inputs are zero, any positive number serves as damping.
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


def rounded_on(program: ControllerProgram, windows: Sequence[Array]) -> RoundedProgram:
    """Round a program on recorded windows (L, S+1) of L rows and S sensors. Raises ExportError if there are no
    windows."""
    inputs = _by_matrix(layer_inputs(program, windows))
    return RoundedProgram.of(program, lambda name, weight: quantise_on(weight, inputs[name]))


def _by_matrix(seen: LayerInputs) -> dict[str, Array]:
    return {
        "lstm.weight_input": seen.row,
        "lstm.weight_recurrent": seen.recurrent,
        "encoder.hidden.weight": seen.head,
        "encoder.output.weight": seen.latent,
        "dynamics.input.weight": seen.state,
        "dynamics.hidden.weight": seen.hidden1,
        "dynamics.output.weight": seen.hidden2,
        "decoder.input.weight": seen.z,
        **{f"decoder.blocks.{i}.linear.weight": x for i, x in enumerate(seen.blocks)},
        "decoder.output.weight": seen.forces,
        "prior.first": seen.prior,
        "prior.sums": seen.sums,
    }
