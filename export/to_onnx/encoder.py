"""The temporal encoder as ONNX nodes: scaling, one LSTM operator, layer norm, two linear layers."""

import numpy as np

from contract.arrays import Index
from export.program.controller_program import ControllerProgram
from export.to_onnx.graph_builder import Graph
from export.to_onnx.weights import NormNames, Store


def lower_encoder(graph: Graph, program: ControllerProgram, window: str, store: Store) -> str:
    """z_t as a row (1, n_z) from the window (L, S+1)."""
    weights, scaling = program.encoder, program.scaling
    width = weights.lstm.width
    gates = _onnx_gates(width)
    mean = graph.constant(scaling.window_mean, "window_mean")
    # As a factor, a deviation too small for float32 is refused where a divisor would round to zero.
    std = np.array(scaling.window_std)
    rows = window
    if program.encoder_rows < program.window:
        ends = graph.index([program.window - program.encoder_rows]), graph.index([program.window])
        rows = graph.op("Slice", window, *ends, graph.index([0]))
    scaled = graph.op("Mul", graph.op("Sub", rows, mean), graph.constant(1.0 / std, "1 / window_std"))

    # The operator has a direction axis in front of everything, and a batch axis of one in the sequence.
    _, hidden = graph.ops(
        "LSTM",
        graph.op("Unsqueeze", scaled, graph.index([1])),
        store(graph, "lstm.weight_input", rows=gates, leading=1),
        store(graph, "lstm.weight_recurrent", rows=gates, leading=1),
        graph.constant(
            np.concatenate([weights.lstm.bias_input[gates], weights.lstm.bias_recurrent[gates]])[None],
            "lstm.bias",
        ),
        outputs=2,
        hidden_size=width,
    )
    row = graph.op("Squeeze", hidden, graph.index([0]))
    normed = NormNames(graph, weights.norm, "encoder.norm").apply(graph, row)
    middle = graph.op(
        "Gemm",
        normed,
        store(graph, "encoder.hidden.weight"),
        graph.constant(weights.hidden.bias, "encoder.hidden.bias"),
        transB=1,
    )
    return graph.op(
        "Gemm",
        graph.op("Elu", middle),
        store(graph, "encoder.output.weight"),
        graph.constant(weights.output.bias, "encoder.output.bias"),
        transB=1,
    )


def _onnx_gates(width: int) -> Index:
    """Rows in PyTorch's gate order i, f, g, o in ONNX's order i, o, f, c (its c is PyTorch's g)."""
    i, f, g, o = np.split(np.arange(4 * width), 4)
    return np.concatenate([i, o, f, g])
