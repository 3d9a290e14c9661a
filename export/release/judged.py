"""The check of a graph before signing. A graph must pass onnx's checker and use only operators of exported graphs."""

from collections.abc import Iterator
from typing import Final

import onnx

from contract.controller.estimator import ESTIMATOR
from contract.errors import BundleControllerError
from contract.printable import shown
from contract.release.checks import CONTROLLER, Bundle
from contract.runtime.onnx_session import OnnxController, OnnxEstimator

OPERATORS: Final = frozenset(
    (
        *("Abs", "Add", "Cast", "Clip", "Concat", "CumSum", "DequantizeLinear", "Div", "Elu", "Equal", "Exp", "Gemm"),
        *("Greater", "Identity", "LSTM", "LayerNormalization", "MatMul", "Min", "Mul", "ReduceMax", "ReduceMean"),
        *("ReduceMin", "ReduceSum", "Relu", "Reshape", "Scan", "Sign", "Slice", "Split", "Sqrt", "Squeeze", "Sub"),
        *("Sum", "Tanh", "Transpose", "Unsqueeze", "Where"),
    )
)
SHAPING: Final = frozenset(
    ("ReduceMax", "ReduceMean", "ReduceMin", "ReduceSum", "Reshape", "Slice", "Split", "Squeeze", "Unsqueeze")
)
"""Operators whose inputs after the first input determine the output's shape, and thus the duration of a step."""


def judge(bundle: Bundle) -> None:
    """Check a bundle's graphs and run a step of each graph, in bounded time and memory. Raises BundleControllerError if
    a graph is not valid, or does not fit the manifest."""
    for name in (CONTROLLER, ESTIMATOR):
        if name in bundle.files:
            try:
                check_model(bundle.files[name])
            except ValueError as error:
                raise BundleControllerError(f"bundle {bundle.manifest.name}: {name}: {shown(error)}") from error
    OnnxController.of(bundle)
    OnnxEstimator.of(bundle)


def check_model(content: bytes) -> int:
    """Return the number of nodes of a valid graph. Raises ValueError, with the reason, for an invalid graph."""
    try:
        model = onnx.load_from_string(content)
        onnx.checker.check_model(model, full_check=True)
    except Exception as error:  # from protobuf, from the checker, or from the inference of shapes
        raise ValueError(f"onnx refuses the graph: {error}") from error
    if model.functions or model.training_info:
        raise ValueError("the graph has its own functions or training information")
    nodes = list(_nodes(model.graph))
    constants = {one.name for one in model.graph.initializer}
    for node in nodes:
        if node.domain or node.op_type not in OPERATORS:
            raise ValueError(f"operator {node.op_type!r} of domain {node.domain!r}: no controller uses this operator")
        for name in node.input[1:] if node.op_type in SHAPING else ():
            if name and name not in constants:
                raise ValueError(f"input {name!r} of {node.op_type} is computed, but must be a constant")
    return len(nodes)


def _nodes(graph: onnx.GraphProto) -> Iterator[onnx.NodeProto]:
    for node in graph.node:
        yield node
        for part in node.attribute:
            yield from _nodes(part.g)
