"""The three networks in NumPy float64 (paper, section 2.2 and table 1), with the adjoints the MPC needs.

This is the specification that every lowering is tested against. Latent states z are (..., n_z), actions a
(...,) in U_inf W, forces (..., 2) are the physical (Cd, Cl).
"""

import numpy as np

from export.program.controller_program import ControllerProgram
from export.program.weights import Array
from export.reference.layers import (
    elu,
    elu_vjp,
    layer_norm,
    layer_norm_vjp,
    linear,
    linear_vjp,
    sigmoid,
)


def encode(program: ControllerProgram, window: Array) -> Array:
    """z_t = f_enc(S_t).

    With x_k the scaled row k of the window, an LSTM runs over the L rows from h = c = 0:
    c = sigmoid(f) c + sigmoid(i) tanh(g) and h = sigmoid(o) tanh(c), where (i, f, g, o) = W x_k + U h + b.
    Then z = W_2 ELU(W_1 LayerNorm(h) + b_1) + b_2.

    Args:
        window: (L, S+1), oldest row first; row k is (Cp_k, a_{k-1}), unscaled.

    Returns:
        The latent state, (n_z,).
    """
    weights = program.encoder
    h = encoder_output(program, window)
    return linear(weights.output, elu(linear(weights.hidden, layer_norm(weights.norm, h))))


def encoder_output(program: ControllerProgram, window: Array) -> Array:
    """h of the LSTM after the last row, (width,)."""
    lstm = program.encoder.lstm
    h = np.zeros(lstm.width)
    c = np.zeros(lstm.width)
    for x in _scale_window(program, window):
        gates = lstm.weight_input @ x + lstm.bias_input
        gates += lstm.weight_recurrent @ h + lstm.bias_recurrent
        i, f, g, o = np.split(gates, 4)
        c = sigmoid(f) * c + sigmoid(i) * np.tanh(g)
        h = sigmoid(o) * np.tanh(c)
    return h


def step(program: ControllerProgram, z: Array, a: Array) -> Array:
    """z_{t+1} = z_t + f_dyn(z_t, a_t); (..., n_z), (...,) -> (..., n_z).

    f_dyn = W_3 ELU(LN(W_2 ELU(LN(W_1 [z, a / action_std] + b_1)) + b_2)) + b_3.
    """
    weights = program.dynamics
    first = linear(weights.input, _with_action(program, z, a))
    second = linear(weights.hidden, elu(layer_norm(weights.norm_in, first)))
    return z + linear(weights.output, elu(layer_norm(weights.norm_hidden, second)))


def step_vjp(program: ControllerProgram, z: Array, a: Array, dz_next: Array) -> tuple[Array, Array]:
    """Adjoint of `step`: dJ/dz_{t+1} -> (dJ/dz_t, dJ/da_t), shapes (..., n_z) -> (..., n_z), (...,)."""
    weights = program.dynamics
    first = linear(weights.input, _with_action(program, z, a))
    normed_first = layer_norm(weights.norm_in, first)
    second = linear(weights.hidden, elu(normed_first))
    normed_second = layer_norm(weights.norm_hidden, second)

    d = linear_vjp(weights.output, dz_next)
    d = layer_norm_vjp(weights.norm_hidden, second, elu_vjp(normed_second, d))
    d = linear_vjp(weights.hidden, d)
    d = layer_norm_vjp(weights.norm_in, first, elu_vjp(normed_first, d))
    d = linear_vjp(weights.input, d)
    return dz_next + d[..., :-1], d[..., -1] / program.scaling.action_std


def decode(program: ControllerProgram, z: Array) -> Array:
    """(Cd, Cl) = force_mean + force_std f_dec(z); (..., n_z) -> (..., 2).

    f_dec: x = W_0 z + b_0, then x <- x + ELU(LN(W_i x + b_i)) for every block, then W_out x + b_out.
    """
    weights = program.decoder
    x = linear(weights.input, z)
    for block in weights.blocks:
        x = x + elu(layer_norm(block.norm, linear(block.linear, x)))
    return linear(weights.output, x) * program.scaling.force_std + program.scaling.force_mean


def decode_vjp(program: ControllerProgram, z: Array, dforces: Array) -> Array:
    """Adjoint of `decode`: dJ/d(Cd, Cl) (..., 2) -> dJ/dz (..., n_z)."""
    weights = program.decoder
    inputs = [linear(weights.input, z)]
    for block in weights.blocks:
        inputs.append(inputs[-1] + elu(layer_norm(block.norm, linear(block.linear, inputs[-1]))))

    d = linear_vjp(weights.output, dforces * program.scaling.force_std)
    for block, x in zip(reversed(weights.blocks), reversed(inputs[:-1]), strict=True):
        before = linear(block.linear, x)
        through = elu_vjp(layer_norm(block.norm, before), d)
        d = d + linear_vjp(block.linear, layer_norm_vjp(block.norm, before, through))
    return linear_vjp(weights.input, d)


def _scale_window(program: ControllerProgram, window: Array) -> Array:
    return np.asarray((window - program.scaling.window_mean) / program.scaling.window_std)


def _with_action(program: ControllerProgram, z: Array, a: Array) -> Array:
    return np.concatenate([z, np.asarray(a)[..., None] / program.scaling.action_std], axis=-1)
