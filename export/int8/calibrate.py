"""The program that int8 lowerings compute: matrices rounded; if there are recorded windows, in view of
what each layer sees on them.

With windows, every matrix is rounded with error feedback on the inputs of its own layer (`feedback_rounding`,
`layer_inputs`). Correcting biases by the mean of what is left was tried and dropped: it gains nothing after that.
"""

from collections.abc import Sequence

from export.int8.error_feedback import quantise_on
from export.int8.layer_inputs import LayerInputs, layer_inputs
from export.int8.nearest import quantise, with_matrices
from export.program.controller_program import ControllerProgram
from export.program.weights import Array


def rounded_program(program: ControllerProgram, windows: Sequence[Array] | None) -> ControllerProgram:
    """What every int8 lowering computes.

    Args:
        windows: recorded ones (L, S+1) to calibrate on; rounded to nearest if None.

    Raises:
        ExportError: no windows in the sequence.
    """
    if windows is None:
        return quantise(program)
    inputs = _by_layer(layer_inputs(program, windows))
    return with_matrices(program, lambda name, weight: quantise_on(weight, inputs[name]))


def _by_layer(seen: LayerInputs) -> dict[str, Array]:
    return {
        "encoder.lstm.weight_input": seen.row,
        "encoder.lstm.weight_recurrent": seen.recurrent,
        "encoder.hidden": seen.head,
        "encoder.output": seen.latent,
        "dynamics.input": seen.state,
        "dynamics.hidden": seen.hidden1,
        "dynamics.output": seen.hidden2,
        "decoder.input": seen.z,
        **{f"decoder.blocks.{i}": x for i, x in enumerate(seen.blocks)},
        "decoder.output": seen.forces,
    }
