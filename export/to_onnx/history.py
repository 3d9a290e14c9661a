"""The rows of differences and actions as ONNX nodes (`export.reference.history`)."""

import numpy as np

from export.to_onnx.graph_builder import Graph


def lower_history(graph: Graph, window: str, length: int, pairs: int) -> str:
    """Rows (Cp_k, a_{k-1}), (L, S+1), as (1, L (p + 1) - 1): y_k and a_k in turn, without the last action.

    The first row's action is older than the memory: it is dropped, and the others move up by a row.
    """
    signs = np.zeros((2 * pairs + 1, pairs + 1))
    for pair in range(pairs):
        signs[2 * pair, pair + 1], signs[2 * pair + 1, pair + 1] = 1.0, -1.0
    signs[-1, 0] = 1.0
    # Rows (a_{k-1}, y_k), one after the other: without the first number it is the history.
    turned = graph.op("MatMul", window, graph.constant(signs, "differences"))
    size = length * (pairs + 1)
    row = graph.op("Reshape", turned, graph.index([1, size]))
    return graph.slice(row, 1, size, 1)
