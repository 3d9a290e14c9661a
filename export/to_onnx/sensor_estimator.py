"""The estimates of pressures from each other as ONNX nodes, all views of the window in one batch, and back again."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt
import onnx
from onnx import numpy_helper

from contract.controller.estimator import (
    ESTIMATOR,
    ESTIMATOR_INPUT,
    ESTIMATOR_OUTPUT,
    REACH,
    EstimatorNetwork,
    estimator_shapes,
    views,
)
from contract.errors import ExportError
from export.int8.nearest import Int8Matrix
from export.int8.rounded_estimator import RoundedEstimator, of_matrices
from export.to_onnx.graph_builder import Graph

DOC: Final = "Pressures estimated from each other: see contract.controller.estimator"


def build_estimator(rounded: RoundedEstimator) -> onnx.ModelProto:
    """`sensors.onnx` of a network; raises ExportError if a number of it has no finite float32."""
    network = rounded.network
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
    within = graph.op("Clip", scaled, graph.constant(-REACH, "least"), graph.constant(REACH, "most"))
    flat = graph.op("Reshape", within, graph.index([len(seen_by), length * (sensors + 1)]))
    value = graph.op("Concat", flat, graph.constant(hidden, "hidden"), axis=1)
    for number, (matrix, (_, bias)) in enumerate(zip(rounded.matrices, network.layers, strict=True)):
        value = graph.op("Relu", value) if number else value
        weight = _stored(graph, matrix, f"layer_{number}.weight")
        value = graph.op("Gemm", value, weight, graph.constant(bias, f"layer_{number}.bias"), transB=1)
    spread = graph.op("Mul", value, graph.constant(network.std[:-1], "pressure_std"))
    pressures = graph.op("Add", spread, graph.constant(network.mean[:-1], "pressure_mean"))
    graph.output(pressures, shapes[ESTIMATOR_OUTPUT], ESTIMATOR_OUTPUT)
    return graph.model("sensors", DOC)


def read_estimator(content: bytes) -> RoundedEstimator:
    """The network of a graph that `build_estimator` wrote, in a verified bundle, by the names of its constants.

    Raises:
        ExportError: it has other constants; weights in float32, as bundles before version 0.6 have them, are some.
    """
    graph = onnx.load_from_string(content).graph
    constants = {item.name.rsplit("_", 1)[0]: numpy_helper.to_array(item) for item in graph.initializer}
    try:
        layers = max(1, sum(name.endswith(".weight.int8") for name in constants))
        matrices = [_matrix(constants, f"layer_{number}.weight") for number in range(layers)]
        biases = [constants[f"layer_{number}.bias"].astype(np.float64) for number in range(layers)]
        std = 1.0 / constants["kept / std"].astype(np.float64).max(axis=(0, 1))
        network = EstimatorNetwork(
            window=graph.input[0].type.tensor_type.shape.dim[0].dim_value,
            mean=constants["mean"].astype(np.float64),
            std=std,
            layers=[(matrix.values.astype(np.float64), bias) for matrix, bias in zip(matrices, biases, strict=True)],
        )
    except KeyError as error:
        raise ExportError(f"{ESTIMATOR}: {error} is missing: fit it anew (stillwake bundle renew --sensors)") from error
    return of_matrices(network, matrices)


def _stored(graph: Graph, matrix: Int8Matrix, name: str) -> str:
    values = graph.stored(matrix.values, f"{name}.int8")
    scales = graph.stored(matrix.scales, f"{name}.scale")
    zero_points = graph.stored(np.zeros(len(matrix.scales), np.int8), "zero_points")
    return graph.op("DequantizeLinear", values, scales, zero_points, axis=0)


def _matrix(constants: dict[str, npt.NDArray[Any]], name: str) -> Int8Matrix:
    return Int8Matrix(values=constants[f"{name}.int8"], scales=constants[f"{name}.scale"])
