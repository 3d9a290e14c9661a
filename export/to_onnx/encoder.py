"""The temporal encoder as ONNX nodes: scaling, one LSTM operator, layer norm, two linear layers."""

import numpy as np

from contract.arrays import Array, Index
from export.program.controller_program import ControllerProgram
from export.to_onnx.graph_builder import Graph, NormNames, PutMatrix


def lower_encoder(graph: Graph, program: ControllerProgram, window: str, store: PutMatrix) -> str:
    """Add nodes that compute the latent state z_t as a row (1, n_z), from the window (L, S+1)."""
    weights, scaling = program.encoder, program.scaling
    width = weights.lstm.width
    gates = _onnx_gates(width)
    mean = graph.constant(scaling.window_mean, "window_mean")
    # The window is multiplied by 1 / std, so that a standard deviation too small for float32 is refused. In a division,
    # it would be rounded to zero.
    std = np.array(scaling.window_std)
    rows = window
    if program.encoder_rows < program.window:
        rows = graph.slice(window, program.window - program.encoder_rows, program.window, 0)
    scaled = graph.op("Mul", graph.op("Sub", rows, mean), graph.constant(1.0 / std, "1 / window_std"))

    def linear(x: str, name: str, bias: Array) -> str:
        weight = store(graph, f"encoder.{name}.weight")
        return graph.op("Gemm", x, weight, graph.constant(bias, f"encoder.{name}.bias"), transB=1)

    # ONNX's LSTM expects the direction as the first axis of its weights, and a batch axis of length one in the
    # sequence.
    biases = np.concatenate([weights.lstm.bias_input[gates], weights.lstm.bias_recurrent[gates]])
    _, hidden = graph.ops(
        "LSTM",
        graph.op("Unsqueeze", scaled, graph.index([1])),
        store(graph, "lstm.weight_input", rows=gates, leading=1),
        store(graph, "lstm.weight_recurrent", rows=gates, leading=1),
        graph.constant(biases[None], "lstm.bias"),
        outputs=2,
        hidden_size=width,
    )
    row = graph.op("Squeeze", hidden, graph.index([0]))
    normed = NormNames(graph, weights.norm, "encoder.norm").apply(graph, row)
    return linear(graph.op("Elu", linear(normed, "hidden", weights.hidden.bias)), "output", weights.output.bias)


def _onnx_gates(width: int) -> Index:
    """Return the indices that reorder rows from PyTorch's gate order i, f, g, o to ONNX's order i, o, f, c; ONNX's c is
    PyTorch's g."""
    i, f, g, o = np.split(np.arange(4 * width), 4)
    return np.concatenate([i, o, f, g])
