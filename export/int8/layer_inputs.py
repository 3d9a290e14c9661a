"""What every layer of the controller sees on recorded windows: the data that int8 rounding is calibrated on.

The encoder's layers see the windows. Dynamics and decoder see roll-outs from every window's latent state under a few
plans: none, full amplitude either way, random ones, and random ones that wander as an optimised plan does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contract.errors import ExportError
from export.program.controller_program import ControllerProgram
from export.program.weights import Array
from export.reference.layers import elu, layer_norm, linear, sigmoid

_RANDOM: Final = 2
_WANDERING: Final = 2
_STRIDE: Final = 0.25
"""Deviation of a wandering plan's steps, as a share of the action limit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LayerInputs:
    """Inputs by layer, one a row; those of dynamics and decoder over all steps of all roll-outs.

    Attributes:
        row, recurrent: scaled rows of the windows, and the LSTM's output before each.
        head, latent: of the encoder's linear layers: after the norm, and after the ELU.
        state: of the dynamics, [z, a / action_std]; its further layers' are `hidden1` and `hidden2`, after the ELUs.
        z: of the decoder.
        blocks: of its blocks; `elus` are the outputs of their ELUs.
        forces: of its last layer.
    """

    row: Array
    recurrent: Array
    head: Array
    latent: Array
    state: Array
    hidden1: Array
    hidden2: Array
    z: Array
    blocks: tuple[Array, ...]
    elus: tuple[Array, ...]
    forces: Array


def layer_inputs(program: ControllerProgram, windows: Sequence[Array], *, seed: int = 0) -> LayerInputs:
    """Run a program on windows (L, S+1); raises ExportError if there are none."""
    if not windows:
        raise ExportError("int8 calibration: no windows to measure activations on")
    encoder, dynamics, decoder = program.encoder, program.dynamics, program.decoder
    rows, recurrent, output = _lstm(program, np.array(windows))
    head = layer_norm(encoder.norm, output)
    latent = elu(linear(encoder.hidden, head))

    plans = _plans(program, np.random.default_rng(seed))
    z = np.repeat(linear(encoder.output, latent)[:, None], len(plans), axis=1)
    states, firsts, seconds, latents = [], [], [], []
    for actions in plans.T / program.scaling.action_std:
        states.append(np.concatenate([z, np.broadcast_to(actions, z.shape[:-1])[..., None]], axis=-1))
        firsts.append(elu(layer_norm(dynamics.norm_in, linear(dynamics.input, states[-1]))))
        seconds.append(elu(layer_norm(dynamics.norm_hidden, linear(dynamics.hidden, firsts[-1]))))
        z = z + linear(dynamics.output, seconds[-1])
        latents.append(z)

    x = linear(decoder.input, _rows(latents))
    blocks, elus = [], []
    for block in decoder.blocks:
        blocks.append(x)
        elus.append(elu(layer_norm(block.norm, linear(block.linear, x))))
        x = x + elus[-1]
    return LayerInputs(
        row=_rows(rows),
        recurrent=_rows(recurrent),
        head=head,
        latent=latent,
        state=_rows(states),
        hidden1=_rows(firsts),
        hidden2=_rows(seconds),
        z=_rows(latents),
        blocks=tuple(blocks),
        elus=tuple(elus),
        forces=x,
    )


def _lstm(program: ControllerProgram, windows: Array) -> tuple[list[Array], list[Array], Array]:
    """Scaled rows and the output before each, both by step, and the last output, (n, width)."""
    lstm, scaling = program.encoder.lstm, program.scaling
    h, c = np.zeros((len(windows), lstm.width)), np.zeros((len(windows), lstm.width))
    rows, before = [], []
    for row in np.moveaxis((windows - scaling.window_mean) / scaling.window_std, 1, 0):
        rows.append(row)
        before.append(h)
        gates = row @ lstm.weight_input.T + lstm.bias_input + h @ lstm.weight_recurrent.T + lstm.bias_recurrent
        i, f, g, o = np.split(gates, 4, axis=-1)
        c = sigmoid(f) * c + sigmoid(i) * np.tanh(g)
        h = sigmoid(o) * np.tanh(c)
    return rows, before, h


def _plans(program: ControllerProgram, rng: np.random.Generator) -> Array:
    h, limit = program.mpc.horizon, program.action_limit
    wandering = np.cumsum(_STRIDE * limit * rng.standard_normal((_WANDERING, h)), axis=1)
    return np.array(
        [
            np.zeros(h),
            np.full(h, limit),
            np.full(h, -limit),
            *rng.uniform(-limit, limit, (_RANDOM, h)),
            *np.clip(wandering, -limit, limit),
        ]
    )


def _rows(parts: Sequence[Array]) -> Array:
    stacked = np.array(parts)
    return stacked.reshape(-1, stacked.shape[-1])
