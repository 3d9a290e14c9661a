"""How large the controller's activations get on recorded windows: what the integer steps of an int8 lowering stand for.

Ranges are largest magnitudes over `layer_inputs`. A lowering adds a margin and saturates beyond it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from contract.arrays import Array
from export.int8.layer_inputs import layer_inputs
from export.program.controller_program import ControllerProgram


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


def activation_ranges(program: ControllerProgram, windows: Sequence[Array]) -> ActivationRanges:
    """Measure the ranges on windows (L, S+1); raises ExportError if there are none."""
    seen = layer_inputs(program, windows)
    return ActivationRanges(
        **{name: _largest(getattr(seen, name)) for name in ("row", "head", "latent", "hidden1", "hidden2", "forces")},
        state=max(_largest(seen.state), _largest(seen.z)),
        blocks=tuple(map(_largest, seen.blocks)),
        elus=tuple(map(_largest, seen.elus)),
    )


def _largest(values: Array) -> float:
    return float(np.abs(values).max())
