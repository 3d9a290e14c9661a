"""A program's weight matrices by name: what rounding replaces, and what a lowering stores.

Names are those of the tensors: `lstm.weight_input`, `dynamics.hidden.weight`, `decoder.blocks.0.linear.weight`. Of the
prior, which is small, these are the matrices on filtered rows: `prior.first` (5 n, F (p + 1)), a row for each schedule
of each unit, and `prior.sums` (n, F p).
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

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
    """The program with every matrix replaced by what `change` makes of its name and itself; all else stays."""

    def linear(name: str, layer: Linear) -> Linear:
        return replace(layer, weight=change(f"{name}.weight", layer.weight))

    def layers(network: str, *names: str) -> dict[str, Any]:
        return {name: linear(f"{network}.{name}", getattr(getattr(program, network), name)) for name in names}

    lstm, blocks = program.encoder.lstm, program.decoder.blocks
    gates: dict[str, Any] = {
        name: change(f"lstm.{name}", getattr(lstm, name)) for name in ("weight_input", "weight_recurrent")
    }
    prior = program.prior
    if prior is not None:
        first, sums = prior.first, prior.sums
        prior = replace(
            prior,
            first=change("prior.first", first.reshape(-1, first[0, 0].size)).reshape(first.shape),
            sums=change("prior.sums", sums.reshape(len(sums), -1)).reshape(sums.shape),
        )
    return replace(
        program,
        prior=prior,
        encoder=replace(program.encoder, lstm=replace(lstm, **gates), **layers("encoder", "hidden", "output")),
        dynamics=replace(program.dynamics, **layers("dynamics", "input", "hidden", "output")),
        decoder=replace(
            program.decoder,
            **layers("decoder", "input"),
            blocks=tuple(
                replace(block, linear=linear(f"decoder.blocks.{i}.linear", block.linear))
                for i, block in enumerate(blocks)
            ),
            **layers("decoder", "output"),
        ),
    )
