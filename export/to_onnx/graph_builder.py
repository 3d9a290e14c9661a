"""A small writer of ONNX graphs: it adds nodes by operator name, shares constants, and lets Scans read outside values.

Matrices that are derived from a weight matrix (transposed, centred) are computed in the outermost graph, never inside a
Scan. For float weights ONNX Runtime folds these nodes when the session is built; for int8 weights the nodes run once
per control step.
"""

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import onnx
from onnx import TensorProto, helper, numpy_helper

from contract.arrays import Array, Index
from export.int8 import Program, RoundedProgram
from export.program.controller_program import matrices
from export.program.weights import LAYER_NORM_EPSILON, Norm, as_float32

OPSET: Final = 18
"""The oldest ONNX operator set that has LayerNormalization and in which every reduction takes its axes as an input."""
IR_VERSION: Final = 8


class Graph:
    """A collection of nodes; every value has a name. A graph from `body()` becomes the body of a Scan (`scan`). A body
    reads any value of the graphs around it by name, and its constants are stored in the outermost graph, once."""

    def __init__(self, parent: "Graph | None" = None) -> None:
        self._root: Graph = self if parent is None else parent._root
        self._nodes: list[onnx.NodeProto] = []
        self._inputs: list[onnx.ValueInfoProto] = []
        self._outputs: list[onnx.ValueInfoProto] = []
        if parent is None:
            self._initializers: dict[str, onnx.TensorProto] = {}
            self._stored: dict[tuple[str, tuple[int, ...], bytes], str] = {}
            self._counter = 0

    def input(self, name: str, shape: Sequence[int]) -> str:
        """Declare a float32 input."""
        name = name if self is self._root else self._root._unique(name)
        self._inputs.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, shape))
        return name

    def output(self, value: str, shape: Sequence[int], name: str | None = None) -> None:
        """Declare a value to be a float32 output, under another name if one is given."""
        if name is not None:
            # An Identity is added only if needed, because inside a Scan its dispatch takes time in every step.
            self._nodes.append(helper.make_node("Identity", [value], [name]))
        self._outputs.append(helper.make_tensor_value_info(name or value, TensorProto.FLOAT, shape))

    def constant(self, values: npt.ArrayLike, name: str = "const") -> str:
        """Add a float32 constant. Raises ExportError if a value is not finite in float32."""
        return self._root._store(name, as_float32(values, name))

    def index(self, values: Sequence[int]) -> str:
        """Add an int64 constant, such as axes, starts, ends or shapes."""
        return self._root._store("index", np.array(values, dtype=np.int64))

    def stored(self, array: npt.NDArray[Any], name: str) -> str:
        """Add a constant of any type, unchanged."""
        return self._root._store(name, array)

    def default(self, name: str, values: npt.ArrayLike) -> str:
        """Add an optional input and its default value."""
        array = np.asarray(values, dtype=np.float32)
        self.input(name, array.shape)
        self._initializers[name] = numpy_helper.from_array(array, name)
        return name

    def op(self, kind: str, *inputs: str, **attributes: Any) -> str:
        """Add a node with one output, and return the output's name."""
        return self.ops(kind, *inputs, outputs=1, **attributes)[0]

    def slice(self, x: str, *bounds: int) -> str:
        """Add a slice of the value `x`. `bounds` has the start, the end and, if it is not the first, the axis."""
        return self.op("Slice", x, *(self.index([bound]) for bound in bounds))

    def ops(self, kind: str, *inputs: str, outputs: int, **attributes: Any) -> tuple[str, ...]:
        """Add a node with several outputs, and return their names."""
        names = tuple(self._root._unique(kind.lower()) for _ in range(outputs))
        self._nodes.append(helper.make_node(kind, list(inputs), list(names), **attributes))
        return names

    def body(self) -> "Graph":
        """Return an empty Scan body within this graph."""
        return Graph(parent=self)

    def scan(
        self, body: "Graph", *, states: Sequence[str], sequences: Sequence[str], reverse: bool = False
    ) -> tuple[str, ...]:
        """Add a Scan of `body` over the first axis of `sequences`. Returns the names of the final states, then of the
        stacked outputs. The body's inputs are the states, then one slice of every sequence. The body's outputs are the
        new states, then the values to stack. With `reverse`, the last slice is read and stacked first."""
        stacked = len(body._outputs) - len(states)
        directions = {"scan_input_directions": [int(reverse)] * len(sequences)}
        if stacked:
            directions["scan_output_directions"] = [int(reverse)] * stacked
        return self.ops(
            "Scan",
            *states,
            *sequences,
            outputs=len(body._outputs),
            body=helper.make_graph(body._nodes, self._root._unique("body"), body._inputs, body._outputs),
            num_scan_inputs=len(sequences),
            **directions,
        )

    def model(self, name: str, doc: str) -> onnx.ModelProto:
        """Return the model after the full check of ONNX, which includes shape inference."""
        graph = helper.make_graph(self._nodes, name, self._inputs, self._outputs, list(self._initializers.values()))
        opset = helper.make_opsetid("", OPSET)
        model = helper.make_model(
            graph, opset_imports=[opset], ir_version=IR_VERSION, producer_name="stillwake", doc_string=doc
        )
        onnx.checker.check_model(model, full_check=True)
        return model

    def _unique(self, stem: str) -> str:
        self._counter += 1
        return f"{stem}_{self._counter}"

    def _store(self, name: str, array: npt.NDArray[Any]) -> str:
        key = (array.dtype.str, array.shape, array.tobytes())
        if key not in self._stored:
            self._stored[key] = self._unique(name)
            self._initializers[self._stored[key]] = numpy_helper.from_array(
                np.asarray(array, order="C"), self._stored[key]
            )
        return self._stored[key]


PutMatrix = Callable[..., str]
"""A function that stores a matrix in a graph by its name, and returns the name of its float32 value (`store_for`)."""


def store_for(program: Program) -> PutMatrix:
    """Return the function that stores a program's matrices (outputs, inputs) by their names
    (`export.program.controller_program`): as float32, or as integers for a rounded program. Its argument `rows` is the
    order of the outputs, if it is not PyTorch's order; `leading` is the number of leading axes of length 1."""
    whole = {} if isinstance(program, RoundedProgram) else matrices(program)

    def store(graph: Graph, name: str, *, rows: Index | None = None, leading: int = 0) -> str:
        order, axes = slice(None) if rows is None else rows, (1,) * leading
        if not isinstance(program, RoundedProgram):
            weight = whole[name][order]
            return graph.constant(weight.reshape(axes + weight.shape), name)
        matrix = program.matrices[name]
        values, scales = matrix.values[order], matrix.scales[order]
        return dequantised(graph, values.reshape(axes + values.shape), scales, name, axis=leading)

    return store


def dequantised(
    graph: Graph, values: npt.NDArray[np.int8], scales: npt.NDArray[np.float32], name: str, *, axis: int = 0
) -> str:
    """Store the integers of a matrix, one byte per weight and one scale per row, and return the name of its float32
    value. This value must be used directly in a product or a sum. ONNX Runtime moves a DequantizeLinear past operators
    that only rearrange values (Transpose, Slice, Unsqueeze). Version 1.20 aborts when it moves a DequantizeLinear with
    one scale per row."""
    stored, by_row = graph.stored(values, f"{name}.int8"), graph.stored(scales, f"{name}.scale")
    zero_points = graph.stored(np.zeros(len(scales), np.int8), "zero_points")
    return graph.op("DequantizeLinear", stored, by_row, zero_points, axis=axis)


def centred(graph: Graph, weight: str) -> str:
    """Add C W with C = I - e e^T / n, where e is a vector of n ones: the mean over the n outputs is subtracted from the
    matrix W. The product of C W with an input has mean zero over the outputs. A layer norm gives the same result after
    W and after C W. The norm's adjoint ends in a product with C, which C W already contains: (W^T C) v = (C W)^T v."""
    return graph.op("Sub", weight, graph.op("ReduceMean", weight, graph.index([0]), keepdims=1))


def centred_bias(bias: Array) -> Array:
    """Return the bias minus its mean, for a layer with a centred matrix (`centred`)."""
    return np.asarray(bias - bias.mean())


def transposed(graph: Graph, weight: str) -> str:
    """Add the transposed matrix (inputs, outputs), by which a row vector is multiplied."""
    return graph.op("Transpose", weight, perm=[1, 0])


class NormNames:
    """The names of a layer norm's constants in the graph."""

    def __init__(self, graph: Graph, norm: Norm, name: str) -> None:
        self.width = len(norm.weight)
        self.gain = graph.constant(norm.weight, f"{name}.weight")
        self.offset = graph.constant(norm.bias, f"{name}.bias")

    def apply(self, graph: Graph, x: str) -> str:
        """Add nodes that compute the layer norm LN(x) over the last axis."""
        return graph.op("LayerNormalization", x, self.gain, self.offset, epsilon=LAYER_NORM_EPSILON)

    def normalise(self, graph: Graph, x: str) -> tuple[str, str]:
        """Add nodes that compute xhat and r = 1 / sqrt(var x + eps). The first and the third output of
        LayerNormalization with gain 1 and offset 0 are these values."""
        one, zero = graph.constant(np.ones(self.width)), graph.constant(np.zeros(self.width))
        xhat, _, inverse_std = graph.ops("LayerNormalization", x, one, zero, outputs=3, epsilon=LAYER_NORM_EPSILON)
        return xhat, inverse_std

    def with_inverse_std(self, graph: Graph, x: str) -> tuple[str, str]:
        """Add nodes that compute LN(x) over the last axis, and r = 1 / sqrt(var x + eps)."""
        constants = (self.gain, self.offset)
        y, _, inverse_std = graph.ops("LayerNormalization", x, *constants, outputs=3, epsilon=LAYER_NORM_EPSILON)
        return y, inverse_std
