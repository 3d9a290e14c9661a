"""The three networks in NumPy float64 (paper, section 2.2 and table 1), with the adjoints for the MPC. Tests compare
every lowering with this specification.

All functions act on the last axes of their arrays, with any leading axes: windows are (..., L, S+1), latent states z
(..., n_z), actions a (...,) in U_inf W, and forces (..., 2) are the physical (Cd, Cl). The `*_layers` functions return
the inputs of every layer of a network, for the adjoints and int8 calibration. A layer's adjoint (vector-Jacobian
product) takes the layer's input and dJ/d(output), and returns dJ/d(input); for y = W x + b, dx = W^T dy.
"""

from typing import NamedTuple, Self

import numpy as np

from contract.arrays import Array
from export.program.controller_program import ControllerProgram
from export.program.weights import LAYER_NORM_EPSILON, Linear, Lstm, Norm


def linear(layer: Linear, x: Array) -> Array:
    """Compute y = W x + b; (..., inputs) -> (..., outputs)."""
    return x @ layer.weight.T + layer.bias


def elu(x: Array) -> Array:
    """Return x for x > 0, exp(x) - 1 otherwise."""
    # The minimum prevents an overflow of expm1 for large positive x, for which `where` does not use this result.
    return np.where(x > 0, x, np.expm1(np.minimum(x, 0.0)))


def elu_adjoint(x: Array, dy: Array) -> Array:
    """Return dx = dy for x > 0, exp(x) * dy otherwise."""
    return np.asarray(dy * np.exp(np.minimum(x, 0.0)))


def layer_norm(norm: Norm, x: Array) -> Array:
    """Compute y = g * xhat + b with xhat = (x - mean(x)) / sqrt(var(x) + 1e-5), where var(x) is divided by n."""
    normalised, _ = _normalise(x)
    return normalised * norm.weight + norm.bias


def layer_norm_adjoint(norm: Norm, x: Array, dy: Array) -> Array:
    """Compute dx = r * (v - mean(v) - xhat * mean(v * xhat)) with v = g * dy and r = 1 / sqrt(var(x) + 1e-5)."""
    normalised, inverse_std = _normalise(x)
    v = dy * norm.weight
    along = (v * normalised).mean(axis=-1, keepdims=True)
    return np.asarray(inverse_std * (v - v.mean(axis=-1, keepdims=True) - normalised * along))


def sigmoid(x: Array) -> Array:
    """Return 1 / (1 + exp(-x)), without overflow for large |x|."""
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * x)))


def _normalise(x: Array) -> tuple[Array, Array]:
    # For short vectors, two thirds of the time of `mean` and `var` is NumPy's overhead, so sums replace these calls.
    n = x.shape[-1]
    centred = x - np.add.reduce(x, axis=-1, keepdims=True) / n
    inverse_std = 1.0 / np.sqrt(np.add.reduce(centred * centred, axis=-1, keepdims=True) / n + LAYER_NORM_EPSILON)
    return centred * inverse_std, inverse_std


class EncoderLayers(NamedTuple):
    """The inputs of the encoder's layers: the n scaled rows (..., n, S+1) that the encoder reads; hidden state h before
    each row, (..., n, width), starting at 0; `head`, LayerNorm(h) after the last row; and the last layer's input."""

    rows: Array
    recurrent: Array
    head: Array
    latent: Array


class NormedLayer(NamedTuple):
    """The values in a layer ELU(LN(W x + b)): input x (..., inputs); W x + b, its layer norm, its ELU, (..., width)."""

    x: Array
    product: Array
    normed: Array
    elu: Array

    @classmethod
    def of(cls, layer: Linear, norm: Norm, x: Array) -> Self:
        product = linear(layer, x)
        normed = layer_norm(norm, product)
        return cls(x, product, normed, elu(normed))

    def adjoint(self, layer: Linear, norm: Norm, dy: Array) -> Array:
        """Compute the gradient with respect to the input x from the gradient with respect to the ELU's output."""
        return layer_norm_adjoint(norm, self.product, elu_adjoint(self.normed, dy)) @ layer.weight


def encode(program: ControllerProgram, window: Array) -> Array:
    """Compute the latent state z_t = f_enc(S_t), (..., n_z), of the window S_t (..., L, S+1), oldest row first; row k
    is (Cp_k, a_{k-1}), unscaled. The encoder reads the newest `encoder_rows` rows. With x_k the scaled row k of the
    window, an LSTM runs over these rows from h = c = 0: c = sigmoid(f) * c + sigmoid(i) * tanh(g) and h = sigmoid(o) *
    tanh(c), where (i, f, g, o) = W x_k + U h + b. Then z = W_2 ELU(W_1 LayerNorm(h) + b_1) + b_2."""
    return linear(program.encoder.output, encoder_layers(program, window).latent)


def encoder_layers(program: ControllerProgram, window: Array) -> EncoderLayers:
    """Return the inputs of the encoder's layers. The arguments are as in `encode`."""
    weights, scaling = program.encoder, program.scaling
    rows = np.asarray((window[..., -program.encoder_rows :, :] - scaling.window_mean) / scaling.window_std)
    h = _lstm(weights.lstm, rows)
    head = layer_norm(weights.norm, h[..., -1, :])
    latent = elu(linear(weights.hidden, head))
    return EncoderLayers(rows=rows, recurrent=h[..., :-1, :], head=head, latent=latent)


def step(program: ControllerProgram, z: Array, a: Array) -> Array:
    """Compute the next latent state z_{t+1} = z_t + f_dyn(z_t, a_t); (..., n_z), (...,) -> (..., n_z). f_dyn = W_3
    ELU(LN(W_2 ELU(LN(W_1 [z, a / action_std] + b_1)) + b_2)) + b_3."""
    return z + linear(program.dynamics.output, dynamics_layers(program, z, a)[1].elu)


def step_adjoint(program: ControllerProgram, z: Array, a: Array, dz_next: Array) -> tuple[Array, Array]:
    """Compute the adjoint of `step`: dJ/dz_{t+1} -> (dJ/dz_t, dJ/da_t), shapes (..., n_z) -> (..., n_z), (...,)."""
    weights, (first, second) = program.dynamics, dynamics_layers(program, z, a)
    d = second.adjoint(weights.hidden, weights.norm_hidden, dz_next @ weights.output.weight)
    d = first.adjoint(weights.input, weights.norm_in, d)
    return dz_next + d[..., :-1], d[..., -1] / program.scaling.action_std


def dynamics_layers(program: ControllerProgram, z: Array, a: Array) -> tuple[NormedLayer, NormedLayer]:
    """Return the first two layers of the dynamics; the input is [z, a / action_std]. Arguments are as in `step`."""
    weights = program.dynamics
    state = np.concatenate([z, np.asarray(a)[..., None] / program.scaling.action_std], axis=-1)
    first = NormedLayer.of(weights.input, weights.norm_in, state)
    return first, NormedLayer.of(weights.hidden, weights.norm_hidden, first.elu)


def decode(program: ControllerProgram, z: Array) -> Array:
    """Compute (Cd, Cl) = force_mean + force_std f_dec(z); (..., n_z) -> (..., 2). f_dec: x = W_0 z + b_0, then x <- x +
    ELU(LN(W_i x + b_i)) for every block, then W_out x + b_out."""
    scaled = linear(program.decoder.output, decoder_layers(program, z)[1])
    return scaled * program.scaling.force_std + program.scaling.force_mean


def decode_adjoint(program: ControllerProgram, z: Array, dforces: Array) -> Array:
    """Compute the adjoint of `decode`: dJ/d(Cd, Cl) (..., 2) -> dJ/dz (..., n_z)."""
    weights, (layers, _) = program.decoder, decoder_layers(program, z)
    d = (dforces * program.scaling.force_std) @ weights.output.weight
    for block, inside in zip(reversed(weights.blocks), reversed(layers), strict=True):
        d = d + inside.adjoint(block.linear, block.norm, d)
    return d @ weights.input.weight


def decoder_layers(program: ControllerProgram, z: Array) -> tuple[list[NormedLayer], Array]:
    """Return the decoder's blocks at latent states z (..., n_z), and the input of its last layer, (..., width)."""
    x = linear(program.decoder.input, z)
    blocks = []
    for block in program.decoder.blocks:
        blocks.append(NormedLayer.of(block.linear, block.norm, x))
        x = x + blocks[-1].elu
    return blocks, x


def _lstm(lstm: Lstm, rows: Array) -> Array:
    """Return the hidden states h_0 .. h_L, (..., L+1, width), for L rows (..., L, S+1)."""
    h = c = np.zeros((*rows.shape[:-2], lstm.width))
    outputs = [h]
    for x in np.moveaxis(rows, -2, 0):
        gates = x @ lstm.weight_input.T + lstm.bias_input
        gates += h @ lstm.weight_recurrent.T + lstm.bias_recurrent
        i, f, g, o = np.split(gates, 4, axis=-1)
        c = sigmoid(f) * c + sigmoid(i) * np.tanh(g)
        h = sigmoid(o) * np.tanh(c)
        outputs.append(h)
    return np.stack(outputs, axis=-2)
