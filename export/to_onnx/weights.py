"""How a weight matrix is stored in the graph: as float32, or as int8 with a DequantizeLinear behind it.

Everything derived from a matrix (its transpose, its centred form) is computed from it in the outermost graph,
never inside a Scan: for float weights ONNX Runtime folds these nodes when the session is built, for int8
weights they run once per control step.
"""

from typing import Final, Literal, Protocol, get_args

import numpy as np

from contract.errors import ExportError
from export.int8.nearest import quantise_matrix
from export.program.float32 import as_float32
from export.program.weights import LAYER_NORM_EPSILON, Array, Norm
from export.to_onnx.graph_builder import Graph

Precision = Literal["float32", "int8"]


class Store(Protocol):
    """Puts a matrix (outputs, inputs) into the graph and returns the name of its float32 value."""

    def __call__(self, graph: Graph, weight: Array, name: str, *, leading: int = 0) -> str:
        """`leading` axes of length 1 come in front, where an operator wants them."""
        ...


def store_float32(graph: Graph, weight: Array, name: str, *, leading: int = 0) -> str:
    """The matrix rounded to float32."""
    return graph.constant(weight.reshape((1,) * leading + weight.shape), name)


def store_int8(graph: Graph, weight: Array, name: str, *, leading: int = 0) -> str:
    """The matrix as `export.int8.nearest` rounds it: a byte a weight and a scale a row.

    The value must go straight into a product or a sum: ONNX Runtime moves a DequantizeLinear past operators that
    only rearrange (Transpose, Slice, Unsqueeze), and 1.20 aborts on that with a scale a row.
    """
    as_float32(weight, name)  # for its refusal: the scales are float32
    matrix = quantise_matrix(weight)
    values = graph.stored(matrix.values.reshape((1,) * leading + weight.shape), f"{name}.int8")
    scales = graph.stored(matrix.scales, f"{name}.scale")
    zero_points = graph.stored(np.zeros(len(matrix.scales), np.int8), "zero_points")
    return graph.op("DequantizeLinear", values, scales, zero_points, axis=leading)


_STORES: Final[dict[str, Store]] = {"float32": store_float32, "int8": store_int8}


def store_for(precision: str) -> Store:
    """The way to store matrices at a precision; raises ExportError for one that does not exist."""
    if precision not in _STORES:
        raise ExportError(f"precision {precision!r}: must be one of {', '.join(get_args(Precision))}")
    return _STORES[precision]


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
