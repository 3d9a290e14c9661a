"""Symmetric int8 weights, one scale per output row; biases, norms and arithmetic stay float.

W[r, c] ~ scale[r] q[r, c] with q in -127 .. 127 and scale[r] = max_c |W[r, c]| / 127, so that the error of a
weight is at most scale / 2 (half a step). This quarters the file; on x86 it does not shorten the step.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from export.program.controller_program import ControllerProgram
from export.program.weights import Array, Linear

LEVELS: Final = 127
"""Largest magnitude of a quantised weight: -128 is left out, so that negating a row is exact."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Int8Matrix:
    """values (outputs, inputs) int8 and one positive scale per output, float32."""

    values: npt.NDArray[np.int8]
    scales: npt.NDArray[np.float32]

    def dequantised(self) -> npt.NDArray[np.float32]:
        """scale[r] q[r, c], rounded to float32 as ONNX's DequantizeLinear does."""
        return self.values.astype(np.float32) * self.scales[:, None]


def quantise_matrix(weight: Array) -> Int8Matrix:
    """The nearest Int8Matrix of a matrix (outputs, inputs). A row of zeros takes scale 1."""
    largest = np.abs(weight).max(axis=1)
    # The floor keeps the scale a normal float32: below it, a row's products vanish in float32 anyway.
    scales = np.where(largest > 0, np.maximum(largest / LEVELS, np.finfo(np.float32).tiny), 1.0).astype(np.float32)
    steps = np.rint(weight / scales[:, None].astype(np.float64))
    return Int8Matrix(values=np.clip(steps, -LEVELS, LEVELS).astype(np.int8), scales=scales)


def quantise(program: ControllerProgram) -> ControllerProgram:
    """The program with every matrix replaced by what its nearest int8 form stands for."""
    return with_matrices(program, lambda _, weight: quantise_matrix(weight))


def with_matrices(program: ControllerProgram, rounded: Callable[[str, Array], Int8Matrix]) -> ControllerProgram:
    """The program with every matrix replaced by what a form made of its layer's name and itself stands for.

    Layers are named by their place: `encoder.lstm.weight_input`, `dynamics.hidden`, `decoder.blocks.0`.
    """

    def matrix(name: str, weight: Array) -> Array:
        return rounded(name, weight).dequantised().astype(np.float64)

    def linear(name: str, layer: Linear) -> Linear:
        return replace(layer, weight=matrix(name, layer.weight))

    encoder, dynamics, decoder = program.encoder, program.dynamics, program.decoder
    return replace(
        program,
        encoder=replace(
            encoder,
            lstm=replace(
                encoder.lstm,
                weight_input=matrix("encoder.lstm.weight_input", encoder.lstm.weight_input),
                weight_recurrent=matrix("encoder.lstm.weight_recurrent", encoder.lstm.weight_recurrent),
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
                replace(block, linear=linear(f"decoder.blocks.{i}", block.linear))
                for i, block in enumerate(decoder.blocks)
            ),
            output=linear("decoder.output", decoder.output),
        ),
    )
