"""The estimates of pressures from each other as ONNX nodes: all views of the window in one batch."""

from typing import Final

import numpy as np
import onnx

from contract.controller.estimator import (
    ESTIMATOR_INPUT,
    ESTIMATOR_OUTPUT,
    EstimatorNetwork,
    estimator_shapes,
    views,
)
from export.to_onnx.graph_builder import Graph

DOC: Final = "Pressures estimated from each other: see contract.controller.estimator"


def build_estimator(network: EstimatorNetwork) -> onnx.ModelProto:
    """`sensors.onnx` of a network; raises ExportError if a number of it has no finite float32."""
    sensors, length = network.sensors, network.window
    seen_by = views(sensors)
    shapes = estimator_shapes(length, sensors)
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
    flat = graph.op("Reshape", scaled, graph.index([len(seen_by), length * (sensors + 1)]))
    value = graph.op("Concat", flat, graph.constant(hidden, "hidden"), axis=1)
    for number, (weight, bias) in enumerate(network.layers):
        value = graph.op("Relu", value) if number else value
        value = graph.op(
            "Gemm",
            value,
            graph.constant(weight, f"layer_{number}.weight"),
            graph.constant(bias, f"layer_{number}.bias"),
            transB=1,
        )
    spread = graph.op("Mul", value, graph.constant(network.std[:-1], "pressure_std"))
    pressures = graph.op("Add", spread, graph.constant(network.mean[:-1], "pressure_mean"))
    graph.output(pressures, shapes[ESTIMATOR_OUTPUT], ESTIMATOR_OUTPUT)
    return graph.model("sensors", DOC)
