"""How a weight matrix is stored in the graph: as float32, or as int8 with a DequantizeLinear behind it.

Everything derived from a matrix (its transpose, its centred form) is computed from it in the outermost graph,
never inside a Scan: for float weights ONNX Runtime folds these nodes when the session is built, for int8
weights they run once per control step.
"""

from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from contract.arrays import Array, Index
from export.int8.rounded_program import Program, RoundedProgram
from export.program.controller_program import ControllerProgram
from export.program.matrices import matrices
from export.program.weights import LAYER_NORM_EPSILON, Norm
from export.to_onnx.graph_builder import Graph


class Store(Protocol):
    """Puts a matrix (outputs, inputs) of the program into the graph and returns the name of its float32 value."""

    def __call__(self, graph: Graph, name: str, *, rows: Index | None = None, leading: int = 0) -> str:
        """The matrix of this name (`export.program.matrices`).

        Args:
            rows: outputs in another order, where an operator wants one.
            leading: axes of length 1 in front, likewise.
        """


class Float32Store:
    """Matrices rounded to float32."""

    def __init__(self, program: ControllerProgram) -> None:
        self._matrices = matrices(program)

    def __call__(self, graph: Graph, name: str, *, rows: Index | None = None, leading: int = 0) -> str:
        weight = _in_order(self._matrices[name], rows)
        return graph.constant(_with_axes(weight, leading), name)


class Int8Store:
    """The integers of a rounded program: a byte a weight and a scale a row.

    The value must go straight into a product or a sum: ONNX Runtime moves a DequantizeLinear past operators that
    only rearrange (Transpose, Slice, Unsqueeze), and 1.20 aborts on that with a scale a row.
    """

    def __init__(self, program: RoundedProgram) -> None:
        self._matrices = program.matrices

    def __call__(self, graph: Graph, name: str, *, rows: Index | None = None, leading: int = 0) -> str:
        matrix = self._matrices[name]
        values = graph.stored(_with_axes(_in_order(matrix.values, rows), leading), f"{name}.int8")
        scales = graph.stored(_in_order(matrix.scales, rows), f"{name}.scale")
        zero_points = graph.stored(np.zeros(len(matrix.scales), np.int8), "zero_points")
        return graph.op("DequantizeLinear", values, scales, zero_points, axis=leading)


def store_for(program: Program) -> Store:
    """The way to store a program's matrices."""
    return Int8Store(program) if isinstance(program, RoundedProgram) else Float32Store(program)


def _in_order(values: npt.NDArray[Any], rows: Index | None) -> npt.NDArray[Any]:
    return values if rows is None else values[rows]


def _with_axes(values: npt.NDArray[Any], leading: int) -> npt.NDArray[Any]:
    return values.reshape((1,) * leading + values.shape)


def centred(graph: Graph, weight: str) -> str:
    """C W with C = I - 11^T / n: the matrix whose product has mean zero over the outputs.

    A layer norm does not see the difference, and its adjoint, which ends in a product with C, gets that
    product for nothing: (W^T C) v = (C W)^T v.
    """
    return graph.op("Sub", weight, graph.op("ReduceMean", weight, graph.index([0]), keepdims=1))


def centred_bias(bias: Array) -> Array:
    """C b, to go with `centred`."""
    return np.asarray(bias - bias.mean())


def transposed(graph: Graph, weight: str) -> str:
    """The (inputs, outputs) form that a row vector is multiplied by."""
    return graph.op("Transpose", weight, perm=[1, 0])


class NormNames:
    """A layer norm's constants in the graph."""

    def __init__(self, graph: Graph, norm: Norm, name: str) -> None:
        self.width = len(norm.weight)
        self.gain = graph.constant(norm.weight, f"{name}.weight")
        self.offset = graph.constant(norm.bias, f"{name}.bias")

    def apply(self, graph: Graph, x: str) -> str:
        """LN(x) over the last axis."""
        return graph.op("LayerNormalization", x, self.gain, self.offset, epsilon=LAYER_NORM_EPSILON)

    def normalise(self, graph: Graph, x: str) -> tuple[str, str]:
        """xhat and r = 1 / sqrt(var x + eps): the operator with unit gain and its third output."""
        one, zero = graph.constant(np.ones(self.width)), graph.constant(np.zeros(self.width))
        xhat, _, inverse_std = graph.ops("LayerNormalization", x, one, zero, outputs=3, epsilon=LAYER_NORM_EPSILON)
        return xhat, inverse_std

    def with_inverse_std(self, graph: Graph, x: str) -> tuple[str, str]:
        """LN(x) over the last axis, and r."""
        y, _, inverse_std = graph.ops(
            "LayerNormalization", x, self.gain, self.offset, outputs=3, epsilon=LAYER_NORM_EPSILON
        )
        return y, inverse_std
