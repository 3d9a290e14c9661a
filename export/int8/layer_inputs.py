"""The inputs of every layer of the controller on recorded windows: the data for the calibration of int8 rounding.

The encoder runs over the windows. Dynamics and decoder run over roll-outs from every window's latent state with a few
plans: zero, full amplitude in either direction, random plans, and random walks that resemble an optimised plan. The
integer scales of an int8 lowering's activations follow from the largest magnitudes over these inputs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contract.arrays import Array
from contract.errors import ExportError
from export.program.controller_program import ControllerProgram
from export.program.weights import PriorWeights
from export.reference.model import decoder_layers, dynamics_layers, encoder_layers, linear
from export.reference.mpc import rollout
from export.reference.prior import filtered_sums, past_of

_RANDOM: Final = 2
_WANDERING: Final = 2
_STRIDE: Final = 0.25
"""Standard deviation of a random walk's steps, as a share of the action limit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LayerInputs:
    """The inputs of each layer, one input per row. The rows of dynamics and decoder cover all steps of all roll-outs.

    Attributes:
        row, recurrent: scaled rows of the windows, and the LSTM's output before each row.
        head, latent: inputs of the encoder's two linear layers; `head` is after the norm, `latent` is after the ELU.
        state, hidden1, hidden2: inputs of the layers of the dynamics; `state` is [z, a / action_std], with latent state
            z and action a.
        z, blocks, forces: inputs of the decoder, of its blocks and of its last layer; `elus` are the outputs of the
            ELUs in the blocks.
        prior, sums: inputs of the prior: filtered rows of the past, and filtered sums; empty without a prior.
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
    prior: Array
    sums: Array


def layer_inputs(program: ControllerProgram, windows: Sequence[Array]) -> LayerInputs:
    """Run a program on windows (L, S+1) of L rows and S sensors. Raises ExportError if there are no windows."""
    if not windows:
        raise ExportError("int8 calibration: no windows to measure activations with")
    encoder = encoder_layers(program, np.array(windows))
    plans = _plans(program, np.random.default_rng(0))
    # Every latent state is combined with every plan; the rows of one time step are adjacent.
    z = np.repeat(linear(program.encoder.output, encoder.latent), len(plans), axis=0)
    actions = np.tile(plans, (len(windows), 1))
    latents = np.moveaxis(rollout(program, z, actions), 1, 0)
    dynamics = dynamics_layers(program, _rows(latents[:-1]), actions.T.ravel())
    decoder = decoder_layers(program, _rows(latents[1:]))
    return LayerInputs(
        row=_rows(np.moveaxis(encoder.rows, 1, 0)),
        recurrent=_rows(np.moveaxis(encoder.recurrent, 1, 0)),
        head=encoder.head,
        latent=encoder.latent,
        state=dynamics.state,
        hidden1=dynamics.hidden1,
        hidden2=dynamics.hidden2,
        z=_rows(latents[1:]),
        blocks=tuple(block.x for block in decoder.blocks),
        elus=tuple(block.elu for block in decoder.blocks),
        forces=decoder.forces,
        **_of_prior(program.prior, windows),
    )


def _of_prior(prior: PriorWeights | None, windows: Sequence[Array]) -> dict[str, Array]:
    if prior is None:
        return {"prior": np.empty((0, 0)), "sums": np.empty((0, 0))}
    past = [prior.filters.T @ past_of(window, prior.memory)[0] for window in windows]
    sums = [filtered_sums(prior, window) for window in windows]
    return {name: np.array(rows).reshape(len(windows), -1) for name, rows in (("prior", past), ("sums", sums))}


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


def _rows(values: Array) -> Array:
    return values.reshape(-1, values.shape[-1])


@dataclass(frozen=True, kw_only=True)
class ActivationRanges:
    """The largest magnitudes of the layers' inputs, as in `LayerInputs`. `state` is the largest magnitude in the inputs
    of dynamics and decoder."""

    row: float
    head: float
    latent: float
    state: float
    hidden1: float
    hidden2: float
    blocks: tuple[float, ...]
    elus: tuple[float, ...]
    forces: float


def activation_ranges(program: ControllerProgram, windows: Sequence[Array]) -> ActivationRanges:
    """Measure the ranges on windows (L, S+1) of L rows and S sensors. Raises ExportError if there are no windows."""
    seen = layer_inputs(program, windows)
    return ActivationRanges(
        **{name: _largest(getattr(seen, name)) for name in ("row", "head", "latent", "hidden1", "hidden2", "forces")},
        state=max(_largest(seen.state), _largest(seen.z)),
        blocks=tuple(map(_largest, seen.blocks)),
        elus=tuple(map(_largest, seen.elus)),
    )


def _largest(values: Array) -> float:
    return float(np.abs(values).max())
