"""How large the controller's activations get on recorded windows: what the integer steps of an int8 lowering stand for.

Ranges are largest magnitudes over the encoder's passes and over roll-outs from every window's latent state under a few
plans: none, full amplitude either way, and random ones. A lowering adds a margin and saturates beyond it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from contract.errors import ExportError
from export.program import ControllerProgram
from export.reference_layers import elu, layer_norm, linear
from export.reference_model import encode, encoder_output, step
from export.weights import Array

_RANDOM = 3


@dataclass(frozen=True, kw_only=True)
class ActivationRanges:
    """Largest magnitudes.

    Attributes:
        row: a scaled row of the window.
        head: input of the encoder's first linear layer, after the norm.
        latent: input of its second one, after the ELU.
        state: the dynamics' input, [z, a / action_std], and the decoder's.
        hidden1, hidden2: outputs of the dynamics' ELUs.
        blocks: inputs of the decoder's blocks.
        elus: outputs of their ELUs.
        forces: input of the decoder's output layer.
    """

    row: float
    head: float
    latent: float
    state: float
    hidden1: float
    hidden2: float
    blocks: tuple[float, ...]
    elus: tuple[float, ...]
    forces: float


def activation_ranges(program: ControllerProgram, windows: Sequence[Array], *, seed: int = 0) -> ActivationRanges:
    """Measure the ranges on windows (L, S+1); raises ExportError if there are none."""
    if not windows:
        raise ExportError("int8 calibration: no windows to measure activations on")
    rng = np.random.default_rng(seed)
    h, limit = program.mpc.horizon, program.action_limit
    scaling, weights, dynamics = program.scaling, program.encoder, program.dynamics
    mean, std = np.append(scaling.pressure_mean, 0.0), np.append(scaling.pressure_std, scaling.action_std)
    heads = np.array([layer_norm(weights.norm, encoder_output(program, window)) for window in windows])

    plans = np.array([np.zeros(h), np.full(h, limit), np.full(h, -limit), *rng.uniform(-limit, limit, (_RANDOM, h))])
    start = np.array([encode(program, window) for window in windows])
    latents = [np.repeat(start[:, None], len(plans), axis=1)]
    for a in plans.T:
        latents.append(step(program, latents[-1], np.broadcast_to(a, latents[-1].shape[:-1])))
    z = np.array(latents)
    a = np.broadcast_to(plans.T[:, None], (h, len(windows), len(plans))) / scaling.action_std
    inputs = np.concatenate([z[:-1], a[..., None]], axis=-1)
    hidden1 = elu(layer_norm(dynamics.norm_in, linear(dynamics.input, inputs)))
    hidden2 = elu(layer_norm(dynamics.norm_hidden, linear(dynamics.hidden, hidden1)))
    x = linear(program.decoder.input, z)
    blocks, elus = [], []
    for block in program.decoder.blocks:
        added = elu(layer_norm(block.norm, linear(block.linear, x)))
        blocks.append(_largest(x))
        elus.append(_largest(added))
        x = x + added
    return ActivationRanges(
        row=_largest((np.array(windows) - mean) / std),
        head=_largest(heads),
        latent=_largest(elu(linear(weights.hidden, heads))),
        state=max(_largest(z), _largest(a)),
        hidden1=_largest(hidden1),
        hidden2=_largest(hidden2),
        blocks=tuple(blocks),
        elus=tuple(elus),
        forces=_largest(x),
    )


def _largest(values: Array) -> float:
    return float(np.abs(values).max())
