"""The ONNX graph that estimates each pressure from the others. The views of a window are one batch."""

from typing import Final

import numpy as np
import onnx
from onnx import numpy_helper

from contract.controller import estimator
from contract.controller.estimator import ESTIMATOR, ESTIMATOR_INPUT, ESTIMATOR_OUTPUT, REACH, EstimatorNetwork, views
from contract.errors import ExportError
from export.int8 import Int8Matrix, RoundedEstimator
from export.to_onnx.graph_builder import Graph, dequantised

DOC: Final = "Pressures estimated from each other: see contract.controller.estimator"


def build_estimator(rounded: RoundedEstimator) -> onnx.ModelProto:
    """Build the graph `sensors.onnx` for a network. Raises ExportError if a weight is not finite in float32."""
    network = rounded.network
    sensors, length = network.sensors, network.window
    seen_by = views(sensors)
    shapes = estimator.estimator_shapes(length, sensors)
    graph = Graph()
    window = graph.input(ESTIMATOR_INPUT, shapes[ESTIMATOR_INPUT])
    exchange = np.stack([np.eye(sensors + 1)[:, view.order(sensors)] for view in seen_by])
    kept, hidden = np.ones((len(seen_by), 1, sensors + 1)), np.zeros((len(seen_by), sensors))
    for row, view in enumerate(seen_by):
        kept[row, 0, list(view.left_out)] = 0.0
        hidden[row, list(view.left_out)] = 1.0
    ordered = graph.op("MatMul", graph.op("Unsqueeze", window, graph.index([0])), graph.constant(exchange, "exchange"))
    centred = graph.op("Sub", ordered, graph.constant(network.mean, "mean"))
    scaled = graph.op("Mul", centred, graph.constant(kept / network.std, "kept / std"))
    within = graph.op("Clip", scaled, graph.constant(-REACH, "least"), graph.constant(REACH, "most"))
    flat = graph.op("Reshape", within, graph.index([len(seen_by), length * (sensors + 1)]))
    value = graph.op("Concat", flat, graph.constant(hidden, "hidden"), axis=1)
    for number, (matrix, (_, bias)) in enumerate(zip(rounded.matrices, network.layers, strict=True)):
        value = graph.op("Relu", value) if number else value
        weight = dequantised(graph, matrix.values, matrix.scales, f"layer_{number}.weight")
        value = graph.op("Gemm", value, weight, graph.constant(bias, f"layer_{number}.bias"), transB=1)
    spread = graph.op("Mul", value, graph.constant(network.std[:-1], "pressure_std"))
    pressures = graph.op("Add", spread, graph.constant(network.mean[:-1], "pressure_mean"))
    graph.output(pressures, shapes[ESTIMATOR_OUTPUT], ESTIMATOR_OUTPUT)
    return graph.model("sensors", DOC)


def read_estimator(content: bytes) -> RoundedEstimator:
    """Read the network of a graph that `build_estimator` wrote, from a verified bundle. Raises ExportError if the graph
    has another structure, such as the graphs with float32 weights of versions before 0.6."""
    graph = onnx.load_from_string(content).graph
    constants = {item.name: numpy_helper.to_array(item) for item in graph.initializer}
    made_by = {name: node for node in graph.node for name in node.output}
    layers = [node for node in graph.node if node.op_type == "Gemm"]
    weights = [made_by.get(node.input[1]) for node in layers]
    if not layers or any(node is None or node.op_type != "DequantizeLinear" for node in weights):
        raise ExportError(f"{ESTIMATOR}: has no int8 weights; fit a new estimator with bundle renew --dataset DATA")
    stored = [(constants[node.input[0]], constants[node.input[1]]) for node in weights if node is not None]
    matrices = [Int8Matrix(values=values, scales=scales) for values, scales in stored]
    # The first Sub and the first Mul standardise the window.
    mean, kept = (next(node for node in graph.node if node.op_type == kind).input[1] for kind in ("Sub", "Mul"))
    network = EstimatorNetwork(
        window=graph.input[0].type.tensor_type.shape.dim[0].dim_value,
        mean=constants[mean].astype(np.float64),
        std=1.0 / constants[kept].astype(np.float64).max(axis=(0, 1)),
        layers=[
            (matrix.dequantised().astype(np.float64), constants[node.input[2]].astype(np.float64))
            for matrix, node in zip(matrices, layers, strict=True)
        ],
    )
    return RoundedEstimator(network=network, matrices=matrices)
