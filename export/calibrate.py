"""What rounding a matrix does to its output on average, taken back through the bias.

A rounded layer computes W_q x + b instead of W x + b. Over recorded inputs its error has a mean, (W - W_q) mean(x),
which a roll-out adds up step after step. Adding that mean to the bias removes it and costs nothing. Only the dynamics
are corrected: encoder and decoder are applied once, and rounding them hardly moves the plan.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from export.program import ControllerProgram
from export.quantise import quantise
from export.reference_layers import elu, layer_norm, linear
from export.reference_model import encode
from export.weights import Array, Linear


def rounded_program(program: ControllerProgram, windows: Sequence[Array] | None) -> ControllerProgram:
    """What every int8 lowering computes: rounded matrices, and corrected biases where there are windows for it."""
    rounded = quantise(program)
    return rounded if windows is None else correct_biases(program, rounded, windows)


def correct_biases(
    program: ControllerProgram, rounded: ControllerProgram, windows: Sequence[Array]
) -> ControllerProgram:
    """The rounded program with the dynamics' biases corrected.

    Args:
        program: the float program.
        rounded: the same with rounded matrices.
        windows: consecutive recorded windows (L, S+1), at least two; they give latent states and actions.
    """
    exact, coarse = program.dynamics, rounded.dynamics
    z = np.array([encode(program, window) for window in windows[:-1]])
    # The action commanded at k stands in the window of k + 1.
    a = np.array([window[-1, -1] for window in windows[1:]]) / program.scaling.action_std
    x_input = np.concatenate([z, a[:, None]], axis=1)
    x_hidden = elu(layer_norm(exact.norm_in, linear(exact.input, x_input)))
    x_output = elu(layer_norm(exact.norm_hidden, linear(exact.hidden, x_hidden)))
    return replace(
        rounded,
        dynamics=replace(
            coarse,
            input=_corrected(exact.input, coarse.input, x_input),
            hidden=_corrected(exact.hidden, coarse.hidden, x_hidden),
            output=_corrected(exact.output, coarse.output, x_output),
        ),
    )


def _corrected(exact: Linear, coarse: Linear, x: Array) -> Linear:
    return replace(coarse, bias=exact.bias + (exact.weight - coarse.weight) @ x.mean(axis=0))
