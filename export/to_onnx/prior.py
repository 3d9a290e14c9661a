"""The prior of the plan as ONNX nodes: one Scan over the horizon (`export.reference.prior`).

What the schedule makes of the units, and the gates, are made once in a control step.
"""

import numpy as np

from contract.controller.interface import Sizes
from export.program.weights import PriorWeights
from export.to_onnx.graph_builder import Graph
from export.to_onnx.weights import Store, transposed


def lower_prior(
    graph: Graph,
    prior: PriorWeights,
    store: Store,
    sizes: Sizes,
    *,
    window: str,
    committed: str,
    free: str,
    schedule: str,
    reach: str,
    bound: str,
) -> str:
    """The plan (1, H) that the optimiser starts from.

    Args:
        window, committed, free: (L, S+1); (1, H) actions where they are not free; (H,).
        schedule: (5, 1).
        reach: (), how far the goal lets the jets go, in U_inf W.
        bound: (), on |a| in this control step.
    """
    columns, length = prior.pairs + 1, prior.memory * (prior.pairs + 1)
    past, y = _past(graph, prior, sizes, window)
    units, filters = _units(graph, prior, store, schedule), graph.constant(prior.filters.T, "prior.filters")
    gates = _gates(graph, prior, store, sizes, window, schedule, filters)
    output = graph.op("Mul", gates, graph.constant(prior.output[:, None], "prior.output"))
    lowest = graph.op("Sub", graph.constant(0.0), bound)

    body = graph.body()
    rows, now = body.input("past", (prior.memory, columns)), body.input("y", (1, prior.pairs))
    held, chosen = body.input("committed", (1,)), body.input("free", (1,))
    filtered = body.op("Reshape", body.op("MatMul", filters, rows), body.index([1, prior.filters.shape[1] * columns]))
    hidden = body.op("Tanh", body.op("MatMul", filtered, units))
    wanted = body.op("Mul", body.op("Tanh", body.op("MatMul", hidden, output)), reach)
    decide = body.op("Greater", chosen, body.constant(0.5))
    action = body.op("Where", decide, body.op("Clip", wanted, lowest, bound), held)
    row = body.op("Concat", now, action, axis=1)
    after = body.op("Concat", body.slice(rows, 1, prior.memory), row, axis=0)
    predictor = graph.constant(prior.predictor.reshape(-1, length).T, "prior.predictor")
    body.output(after, (prior.memory, columns))
    body.output(body.op("MatMul", body.op("Reshape", after, body.index([1, length])), predictor), (1, prior.pairs))
    body.output(action, (1, 1))

    column = graph.index([sizes.horizon, 1])
    by_step = [graph.op("Reshape", value, column) for value in (committed, free)]
    _, _, actions = graph.scan(body, states=[past, y], sequences=by_step)
    return graph.op("Reshape", actions, graph.index([1, sizes.horizon]))


def _units(graph: Graph, prior: PriorWeights, store: Store, schedule: str) -> str:
    """(F (p + 1), n): what the units multiply the filtered rows with, the sum over the schedule."""
    scheduled, units, count, columns = prior.first.shape
    by_row = graph.op("Mul", schedule, graph.constant(np.ones((1, units))))
    weighted = graph.op("Mul", store(graph, "prior.first"), graph.op("Reshape", by_row, graph.index([-1, 1])))
    stacked = graph.op("Reshape", weighted, graph.index([scheduled, units, count * columns]))
    return transposed(graph, graph.op("ReduceSum", stacked, graph.index([0]), keepdims=0))


def _gates(
    graph: Graph, prior: PriorWeights, store: Store, sizes: Sizes, window: str, schedule: str, filters: str
) -> str:
    """(n, 1)."""
    both = np.zeros((sizes.sensors + 1, prior.pairs))
    for pair in range(prior.pairs):
        both[2 * pair : 2 * pair + 2, pair] = 1.0
    newest = graph.slice(window, sizes.window - prior.memory, sizes.window, 0)
    sums = graph.op("MatMul", filters, graph.op("MatMul", newest, graph.constant(both, "sums")))
    by_sums = graph.op("MatMul", store(graph, "prior.sums"), graph.op("Reshape", sums, graph.index([-1, 1])))
    by_schedule = graph.op("MatMul", graph.constant(prior.gate, "prior.gate"), schedule)
    return graph.op("Add", graph.op("Tanh", graph.op("Add", by_schedule, by_sums)), graph.constant(1.0))


def _past(graph: Graph, prior: PriorWeights, sizes: Sizes, window: str) -> tuple[str, str]:
    """Rows (y, a) before the present one, (M, p + 1), and the differences now, (1, p)."""
    memory, pairs = prior.memory, prior.pairs
    newest = graph.slice(window, sizes.window - memory, sizes.window, 0)
    signs = np.zeros((sizes.sensors + 1, pairs))
    for pair in range(pairs):
        signs[2 * pair, pair], signs[2 * pair + 1, pair] = 1.0, -1.0
    differences = graph.op("MatMul", newest, graph.constant(signs, "differences"))
    # Each pressure's row has the action before it.
    actions = graph.slice(graph.slice(newest, sizes.sensors, sizes.sensors + 1, 1), 1, memory, 0)
    rows = graph.op("Concat", graph.slice(differences, 0, memory - 1, 0), actions, axis=1)
    past = graph.op("Concat", graph.slice(rows, 0, 1, 0), rows, axis=0)
    return past, graph.slice(differences, memory - 1, memory, 0)
