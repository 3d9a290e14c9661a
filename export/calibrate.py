"""The program that int8 lowerings compute: matrices rounded; if there are recorded windows, in view of
what each layer sees on them.

With windows, every matrix is rounded with error feedback on the inputs of its own layer (`feedback_rounding`,
`layer_inputs`). Correcting biases by the mean of what is left was tried and dropped: it gains nothing after that.
"""

from collections.abc import Sequence
from dataclasses import replace

from export.feedback_rounding import quantise_on
from export.layer_inputs import LayerInputs, layer_inputs
from export.program import ControllerProgram
from export.quantise import quantise
from export.weights import Array, Linear


def rounded_program(program: ControllerProgram, windows: Sequence[Array] | None) -> ControllerProgram:
    """What every int8 lowering computes.

    Args:
        windows: recorded ones (L, S+1) to calibrate on; rounded to nearest if None.

    Raises:
        ExportError: no windows in the sequence.
    """
    if windows is None:
        return quantise(program)
    return round_matrices(program, layer_inputs(program, windows))


def round_matrices(program: ControllerProgram, seen: LayerInputs) -> ControllerProgram:
    """The program with every matrix rounded on its inputs."""
    encoder, dynamics, decoder = program.encoder, program.dynamics, program.decoder
    return replace(
        program,
        encoder=replace(
            encoder,
            lstm=replace(
                encoder.lstm,
                weight_input=_rounded(encoder.lstm.weight_input, seen.row),
                weight_recurrent=_rounded(encoder.lstm.weight_recurrent, seen.recurrent),
            ),
            hidden=_rounded_linear(encoder.hidden, seen.head),
            output=_rounded_linear(encoder.output, seen.latent),
        ),
        dynamics=replace(
            dynamics,
            input=_rounded_linear(dynamics.input, seen.state),
            hidden=_rounded_linear(dynamics.hidden, seen.hidden1),
            output=_rounded_linear(dynamics.output, seen.hidden2),
        ),
        decoder=replace(
            decoder,
            input=_rounded_linear(decoder.input, seen.z),
            blocks=tuple(
                replace(block, linear=_rounded_linear(block.linear, x))
                for block, x in zip(decoder.blocks, seen.blocks, strict=True)
            ),
            output=_rounded_linear(decoder.output, seen.forces),
        ),
    )


def _rounded(weight: Array, inputs: Array) -> Array:
    return quantise_on(weight, inputs).dequantised().astype(float)


def _rounded_linear(layer: Linear, inputs: Array) -> Linear:
    return replace(layer, weight=_rounded(layer.weight, inputs))
