"""Graphs that no export writes, made with the `onnx` package: small, and sound but for what a test plants."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from contract.controller.interface import OUTPUTS, Sizes

SIZES = Sizes(window=2, sensors=1, horizon=3)
SHAPES = SIZES.shapes()


def constant(name: str, values: Any, dtype: Any = np.float32) -> onnx.TensorProto:
    return numpy_helper.from_array(np.asarray(values, dtype=dtype), name)


def value(name: str, shape: Sequence[int]) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, list(shape))


def graph_of(
    nodes: Sequence[onnx.NodeProto] = (), constants: Sequence[onnx.TensorProto] = (), plan: str = "plan"
) -> onnx.ModelProto:
    """A controller that keeps its plan, or takes another value for it; further nodes and constants stand before its
    own."""
    own = [
        helper.make_node("Identity", [plan], ["new_plan"]),
        helper.make_node("Identity", ["zero_forces"], ["forces"]),
        helper.make_node("Identity", ["weights"], ["terms"]),
        helper.make_node("ReduceSum", ["plan"], ["cost"], keepdims=0),
    ]
    graph = helper.make_graph(
        [*nodes, *own],
        "planted",
        [value(name, SHAPES[name]) for name in ("window", "plan", "free", "weights")],
        [value(name, SHAPES[name]) for name in OUTPUTS],
        [constant("weights", np.ones(8)), constant("zero_forces", np.zeros((3, 2))), *constants],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=8)


def greedy() -> bytes:
    """One that takes 4 GB where the plan reaches 1, and next to nothing where it is zero."""
    nodes = [
        helper.make_node("ReduceMax", ["plan"], ["largest"], keepdims=0),
        helper.make_node("Mul", ["largest", "many"], ["wanted"]),
        helper.make_node("Cast", ["wanted"], ["count"], to=onnx.TensorProto.INT64),
        helper.make_node("Reshape", ["count", "one"], ["shape"]),
        helper.make_node("Expand", ["many", "shape"], ["taken"]),
        helper.make_node("ReduceSum", ["taken"], ["total"], keepdims=0),
        helper.make_node("Add", ["plan", "total"], ["moved"]),
    ]
    constants = [constant("many", 1e9), constant("one", [1], np.int64)]
    return graph_of(nodes, constants, "moved").SerializeToString()


def outside() -> onnx.TensorProto:
    """A constant, (3, 3), whose numbers lie in `weights.bin`."""
    tensor = TensorProto(name="outside", data_type=TensorProto.FLOAT, dims=[3, 3], data_location=TensorProto.EXTERNAL)
    for key, text in (("location", "weights.bin"), ("offset", "0"), ("length", "36")):
        tensor.external_data.add(key=key, value=text)
    return tensor


def endless() -> bytes:
    """A loop of 2^60 steps, in front of the plan."""
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["go_on"]), helper.make_node("Identity", ["x"], ["y"])],
        "forever",
        [
            helper.make_tensor_value_info("step", TensorProto.INT64, []),
            helper.make_tensor_value_info("go", TensorProto.BOOL, []),
            value("x", (3,)),
        ],
        [helper.make_tensor_value_info("go_on", TensorProto.BOOL, []), value("y", (3,))],
    )
    loop = helper.make_node("Loop", ["many", "yes", "plan"], ["looped"], body=body)
    constants = [constant("many", 2**60, np.int64), constant("yes", True, np.bool_)]
    return graph_of([loop], constants, "looped").SerializeToString()


def enormous() -> bytes:
    """A few kilobytes of constants whose product takes 1.6 GB."""
    nodes = [
        helper.make_node("MatMul", ["column", "row"], ["product"]),
        helper.make_node("ReduceMean", ["product"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["plan", "mean"], ["scaled"]),
    ]
    constants = [constant("column", np.ones((20_000, 1))), constant("row", np.ones((1, 20_000)))]
    return graph_of(nodes, constants, "scaled").SerializeToString()
