"""Rounding in view of recorded windows: every matrix with error feedback on the inputs that its own layer meets on them
(`error_feedback`, `layer_inputs`).

Correcting biases by the mean of what is left was tried and dropped: it gains nothing after that.
"""

from collections.abc import Sequence

from contract.arrays import Array
from export.int8.error_feedback import quantise_on
from export.int8.layer_inputs import LayerInputs, layer_inputs
from export.int8.rounded_program import RoundedProgram
from export.program.controller_program import ControllerProgram


def rounded_on(program: ControllerProgram, windows: Sequence[Array]) -> RoundedProgram:
    """The program rounded on recorded windows (L, S+1); raises ExportError if there are none."""
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
    }
