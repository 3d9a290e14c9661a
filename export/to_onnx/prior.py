"""The prior of the plan as ONNX nodes: one Scan over the horizon (`export.reference.prior`).

The past is one row, oldest differences first. Filters and units are one matrix on it, which is made once in a control
step where the units know the speed. Its weights are float32 in either precision.
"""

import numpy as np

from contract.controller.interface import Sizes
from export.program.float32 import float32_within
from export.program.weights import PriorWeights
from export.to_onnx.graph_builder import Graph


def lower_prior(
    graph: Graph,
    prior: PriorWeights,
    sizes: Sizes,
    limit: float,
    window: str,
    committed: str,
    free: str,
    speed: str | None,
) -> str:
    """The plan (1, H) that the optimiser starts from.

    Args:
        limit: bound on |a|.
        window, committed, free: (L, S+1); (1, H) actions where they are not free; (H,).
        speed: (); None where the units do not know it.
    """
    columns, length = prior.pairs + 1, prior.memory * (prior.pairs + 1)
    bound = graph.constant(float32_within(limit))
    past, y = _past(graph, prior, sizes, window)
    hidden, slope = (prior.by_rows(weights).reshape(-1, length).T for weights in (prior.first, prior.slope))
    matrix = graph.constant(hidden, "prior.hidden")
    if speed is not None:
        beyond = graph.op("Sub", speed, graph.constant(1.0))
        matrix = graph.op("Add", matrix, graph.op("Mul", beyond, graph.constant(slope, "prior.slope")))

    body = graph.body()
    rows, now = body.input("past", (1, length)), body.input("y", (1, prior.pairs))
    held, chosen = body.input("committed", (1,)), body.input("free", (1,))
    units = body.op("Tanh", body.op("MatMul", rows, matrix))
    wanted = body.op("Tanh", body.op("MatMul", units, graph.constant(prior.output[:, None], "prior.output")))
    decide = body.op("Greater", chosen, body.constant(0.5))
    action = body.op("Where", decide, body.op("Mul", wanted, bound), held)
    kept = body.slice(rows, columns, length, 1)
    after = body.op("Concat", kept, now, action, axis=1)
    predictor = graph.constant(prior.predictor.reshape(-1, length).T, "prior.predictor")
    body.output(after, (1, length))
    body.output(body.op("MatMul", after, predictor), (1, prior.pairs))
    body.output(action, (1, 1))

    column = graph.index([sizes.horizon, 1])
    by_step = [graph.op("Reshape", value, column) for value in (committed, free)]
    _, _, actions = graph.scan(body, states=[past, y], sequences=by_step)
    return graph.op("Reshape", actions, graph.index([1, sizes.horizon]))


def _past(graph: Graph, prior: PriorWeights, sizes: Sizes, window: str) -> tuple[str, str]:
    """Rows (y, a) before the present one, (1, M (p + 1)), and the differences now, (1, p)."""
    memory, pairs = prior.memory, prior.pairs
    newest = graph.slice(window, sizes.window - memory, sizes.window, 0)
    row, size = _history(graph, newest, memory, pairs), memory * (pairs + 1) - 1
    known = graph.slice(row, 0, size - pairs, 1)
    oldest = graph.slice(row, 0, pairs + 1, 1)
    now = graph.slice(row, size - pairs, size, 1)
    return graph.op("Concat", oldest, known, axis=1), now


def _history(graph: Graph, window: str, length: int, pairs: int) -> str:
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
