"""A program whose matrices are integers: made once, so that every int8 lowering computes the same one.

ONNX and C take the integers and the scales from here, the reference takes the program that they stand for, and the
hash in manifest and C header is that program's.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from contract.arrays import Array
from contract.release.manifest import Precision
from export.int8.nearest import Int8Matrix, quantise_matrix, row_scales
from export.program.controller_program import ControllerProgram
from export.program.float32 import as_float32
from export.program.matrices import map_matrices


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundedProgram:
    """Int8 weights, all else as it was.

    Attributes:
        source: the program before rounding.
        program: the one that the integers stand for; what the reference computes in its place.
        matrices: integers and scales of every matrix, by the names of `export.program.matrices`.
    """

    source: ControllerProgram
    program: ControllerProgram
    matrices: Mapping[str, Int8Matrix]

    @classmethod
    def of(cls, source: ControllerProgram, rounding: Callable[[str, Array], Int8Matrix]) -> "RoundedProgram":
        """Round every matrix by its name and itself; raises ExportError for one that float32 cannot hold."""
        stored: dict[str, Int8Matrix] = {}

        def change(name: str, weight: Array) -> Array:
            as_float32(weight, name)  # for its refusal: the scales are float32
            rounded = rounding(name, weight)
            dequantised = rounded.dequantised().astype(np.float64)
            # A lowering's scale is the largest float32 weight over 127. In one row of 128 that is the neighbour of the
            # scale which the weight was rounded with, a float32 ulp away.
            stored[name] = Int8Matrix(values=rounded.values, scales=row_scales(dequantised))
            return dequantised

        program = map_matrices(source, change)
        return cls(source=source, program=program, matrices=stored)


Program = ControllerProgram | RoundedProgram
"""What can be lowered; its type is its precision."""


def effective(program: Program) -> ControllerProgram:
    """What a lowering of it computes, as the reference takes it."""
    return program.program if isinstance(program, RoundedProgram) else program


def precision_of(program: Program) -> Precision:
    """Its name in manifests and headers."""
    return "int8" if isinstance(program, RoundedProgram) else "float32"


def rounded_to_nearest(program: ControllerProgram) -> RoundedProgram:
    """Every weight by itself."""
    return RoundedProgram.of(program, lambda _, weight: quantise_matrix(weight))
