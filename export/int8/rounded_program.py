"""A program whose matrices are integers. It is built once, so that all int8 lowerings use equal integers. The reference
uses the program with dequantised weights; the hash of this program is in manifest and C header.

Weights are symmetric int8 with one scale per output row; biases, norms and arithmetic remain float. W[r, c] ~ scale[r]
q[r, c] with q in -127 .. 127 and scale[r] = max_c |W[r, c]| / 127, so that the error of a weight is at most scale / 2.
With int8 the file is a quarter as large; on x86 the control step is not faster. The sensor estimator's matrices are
rounded to nearest in the same way.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.controller.estimator import EstimatorNetwork
from contract.release.manifest import WeightPrecision
from export.program.controller_program import ControllerProgram, map_matrices
from export.program.weights import as_float32

QMAX: Final = 127
"""Largest magnitude of a quantised weight. The integer -128 is not used, so that a row can be negated exactly."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Int8Matrix:
    """A matrix as int8 values (outputs, inputs), and one positive float32 scale per output."""

    values: npt.NDArray[np.int8]
    scales: npt.NDArray[np.float32]

    def dequantised(self) -> npt.NDArray[np.float32]:
        """Return the weights scale[r] q[r, c], rounded to float32 as ONNX's DequantizeLinear does."""
        return self.values.astype(np.float32) * self.scales[:, None]


def quantise_matrix(weight: Array) -> Int8Matrix:
    """Round each weight of a matrix (outputs, inputs) to the nearest integer."""
    scales = row_scales(weight)
    steps = np.rint(weight / scales[:, None].astype(np.float64))
    return Int8Matrix(values=np.clip(steps, -QMAX, QMAX).astype(np.int8), scales=scales)


def row_scales(weight: Array) -> npt.NDArray[np.float32]:
    """Return the scale of every row: the row's largest magnitude divided by 127, or 1 for a row of zeros."""
    largest = np.abs(weight).max(axis=1)
    # The lower bound ensures that the scale is a normal float32. With a smaller scale, the products of the row would
    # vanish in float32 anyway.
    return np.where(largest > 0, np.maximum(largest / QMAX, np.finfo(np.float32).tiny), 1.0).astype(np.float32)


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundedProgram:
    """A program with int8 weights. `source` is the program before rounding; `program` has the dequantised weights, for
    the reference; `matrices` has integers and scales by the names of `export.program.controller_program`."""

    source: ControllerProgram
    program: ControllerProgram
    matrices: Mapping[str, Int8Matrix]

    @classmethod
    def of(cls, source: ControllerProgram, rounding: Callable[[str, Array], Int8Matrix]) -> "RoundedProgram":
        """Round every matrix with `rounding(name, matrix)`. Raises ExportError for a matrix that float32 cannot
        hold."""
        stored: dict[str, Int8Matrix] = {}

        def change(name: str, weight: Array) -> Array:
            as_float32(weight, name)  # raises ExportError if float32 cannot hold a weight; the scales are float32
            rounded = rounding(name, weight)
            dequantised = rounded.dequantised().astype(np.float64)
            # A lowering's scale is the largest float32 weight of a row divided by 127. In one of 128 rows, this scale
            # differs by one float32 ulp from the scale that was used for the rounding.
            stored[name] = Int8Matrix(values=rounded.values, scales=row_scales(dequantised))
            return dequantised

        program = map_matrices(source, change)
        return cls(source=source, program=program, matrices=stored)


Program = ControllerProgram | RoundedProgram
"""A program that can be lowered; its type determines the precision of the weights."""


def effective(program: Program) -> ControllerProgram:
    """Return the program with the weights that a lowering and the reference must use."""
    return program.program if isinstance(program, RoundedProgram) else program


def precision_of(program: Program) -> WeightPrecision:
    """Return the name of the precision in manifests and headers."""
    return "int8" if isinstance(program, RoundedProgram) else "float32"


def rounded_to_nearest(program: ControllerProgram) -> RoundedProgram:
    return RoundedProgram.of(program, lambda _, weight: quantise_matrix(weight))


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundedEstimator:
    """The sensor estimator of a bundle, with the dequantised weights, and the integers of each layer."""

    network: EstimatorNetwork
    matrices: Sequence[Int8Matrix]


def rounded_estimator(network: EstimatorNetwork) -> RoundedEstimator:
    """Round each weight of a network to the nearest integer; a network that is already rounded does not change."""
    matrices = [quantise_matrix(weight) for weight, _ in network.layers]
    layers = [
        (matrix.dequantised().astype(float), bias) for matrix, (_, bias) in zip(matrices, network.layers, strict=True)
    ]
    return RoundedEstimator(network=replace(network, layers=layers), matrices=matrices)
