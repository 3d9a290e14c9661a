"""A program's weight matrices by name: what rounding replaces, and what a lowering stores.

Names are those of the tensors: `lstm.weight_input`, `dynamics.hidden.weight`, `decoder.blocks.0.linear.weight`.
"""

from collections.abc import Callable
from dataclasses import replace

from contract.arrays import Array
from export.program.controller_program import ControllerProgram
from export.program.weights import Linear


def matrices(program: ControllerProgram) -> dict[str, Array]:
    """Every matrix, (outputs, inputs), by its name."""
    found: dict[str, Array] = {}

    def keep(name: str, weight: Array) -> Array:
        found[name] = weight
        return weight

    map_matrices(program, keep)
    return found


def map_matrices(program: ControllerProgram, change: Callable[[str, Array], Array]) -> ControllerProgram:
    """The program with every matrix replaced by what `change` makes of its name and itself; biases and norms stay."""

    def linear(name: str, layer: Linear) -> Linear:
        return replace(layer, weight=change(f"{name}.weight", layer.weight))

    encoder, dynamics, decoder = program.encoder, program.dynamics, program.decoder
    return replace(
        program,
        encoder=replace(
            encoder,
            lstm=replace(
                encoder.lstm,
                weight_input=change("lstm.weight_input", encoder.lstm.weight_input),
                weight_recurrent=change("lstm.weight_recurrent", encoder.lstm.weight_recurrent),
            ),
            hidden=linear("encoder.hidden", encoder.hidden),
            output=linear("encoder.output", encoder.output),
        ),
        dynamics=replace(
            dynamics,
            input=linear("dynamics.input", dynamics.input),
            hidden=linear("dynamics.hidden", dynamics.hidden),
            output=linear("dynamics.output", dynamics.output),
        ),
        decoder=replace(
            decoder,
            input=linear("decoder.input", decoder.input),
            blocks=tuple(
                replace(block, linear=linear(f"decoder.blocks.{i}.linear", block.linear))
                for i, block in enumerate(decoder.blocks)
            ),
            output=linear("decoder.output", decoder.output),
        ),
    )
