"""The prior of the plan as ONNX nodes: one Scan over the horizon (`export.reference.prior`), and the goal
(`contract.controller.goal`). The past is stored as one row, oldest differences first. Once per control step, the graph
computes the gates and the units' matrix for this row. The matrix combines schedule and filters."""

import numpy as np

from contract.controller.goal import DEAREST_EFFORT, DEAREST_LIFT, NARROWEST, SPEED_SCALE
from contract.controller.interface import TERMS, Sizes
from export.program.weights import PriorWeights
from export.to_onnx.graph_builder import Graph, PutMatrix, transposed


def lower_schedule(graph: Graph, weights: str, speed: str | None, share: str) -> tuple[str, str]:
    """Add nodes that compute the schedule (6, 1), and the bound on |a| that the goal allows, a scalar. The inputs are
    weights (8,), a bound on |a| of at most 1 and, if the prior depends on the speed, the ratio of the vehicle's speed
    to the design speed. Both bounds are shares of the program's limit."""
    row = graph.index([1])
    drag, effort, lift = (
        graph.slice(weights, place, place + 1) for place in map(TERMS.index, ("drag_mean", "effort", "lift"))
    )
    asked = graph.op("Concat", effort, lift, axis=0)
    dearest = graph.op("Mul", drag, graph.constant([DEAREST_EFFORT, DEAREST_LIFT]))
    root = graph.op("Sqrt", graph.op("Div", asked, dearest))
    # If the weight of drag is zero, this node divides by zero, but the operator Where then ignores the result.
    any_at_all = graph.op("Cast", graph.op("Greater", asked, graph.constant(0.0)), to=1)
    prices = graph.op("Where", graph.op("Greater", dearest, asked), root, any_at_all)
    one, zero = graph.constant(1.0), graph.constant(0.0)
    scale = graph.constant(1.0 / (1.0 - NARROWEST))
    narrowed = graph.op("Min", graph.op("Mul", graph.op("Sub", one, share), scale), one)
    scaled = zero if speed is None else graph.op("Div", graph.op("Sub", speed, one), graph.constant(SPEED_SCALE))
    below = graph.op("Min", scaled, zero)
    columns = (graph.op("Reshape", value, row) for value in (below, graph.op("Sub", scaled, below), narrowed))
    slower, faster, limit = columns
    parts = graph.constant([1.0]), slower, faster, prices, limit
    schedule = graph.op("Unsqueeze", graph.op("Concat", *parts, axis=0), row)
    reach = graph.op("Sub", one, graph.op("Mul", narrowed, graph.constant(1.0 - NARROWEST)))
    return schedule, reach


def lower_unknown(graph: Graph, weights: str, *, knows_goal: bool) -> str:
    """Add nodes that compute the weights (8,) for iterations that start from a prior's plan. The terms that the prior
    takes into account have weight zero: drag, effort and lift, or only drag."""
    known = {"drag_mean", "effort", "lift"} if knows_goal else {"drag_mean"}
    return graph.op("Mul", weights, graph.constant([float(name not in known) for name in TERMS], "unknown"))


def lower_prior(
    graph: Graph,
    prior: PriorWeights,
    store: PutMatrix,
    sizes: Sizes,
    *,
    window: str,
    committed: str,
    free: str,
    schedule: str,
    reach: str,
    bound: str,
) -> str:
    """Add nodes that compute the plan (1, H) from which the optimiser starts. The arguments are as in
    `export.reference.prior`, except `committed` (1, H), the values of the `schedule` variables (6, 1), and `reach`, the
    bound on |a| that the goal allows; `bound` is the bound in this control step."""
    columns, length = prior.pairs + 1, prior.memory * (prior.pairs + 1)
    past, y = _past(graph, prior, sizes, window)
    units, gates = _units(graph, prior, store, schedule), _gates(graph, prior, store, sizes, window, schedule)
    output = graph.op("Mul", gates, graph.constant(prior.output[:, None], "prior.output"))
    lowest = graph.op("Sub", graph.constant(0.0), bound)

    body = graph.body()
    rows, now = body.input("past", (1, length)), body.input("y", (1, prior.pairs))
    held, chosen = body.input("committed", (1,)), body.input("free", (1,))
    hidden = body.op("Tanh", body.op("MatMul", rows, units))
    wanted = body.op("Mul", body.op("Tanh", body.op("MatMul", hidden, output)), reach)
    decide = body.op("Greater", chosen, body.constant(0.5))
    action = body.op("Where", decide, body.op("Clip", wanted, lowest, bound), held)
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


def _units(graph: Graph, prior: PriorWeights, store: PutMatrix, schedule: str) -> str:
    """Add nodes that compute the matrix of the n units on the past rows, (M (p + 1), n)."""
    scheduled, units, count, columns = prior.first.shape
    by_row = graph.op("Mul", schedule, graph.constant(np.ones((1, units))))
    weighted = graph.op("Mul", store(graph, "prior.first"), graph.op("Reshape", by_row, graph.index([-1, 1])))
    stacked = graph.op("Reshape", weighted, graph.index([scheduled, units, count * columns]))
    by_filter = transposed(graph, graph.op("ReduceSum", stacked, graph.index([0]), keepdims=0))
    # The product with the matrix of filters requires one row per filter.
    by_filter = graph.op("Reshape", by_filter, graph.index([count, columns * units]))
    by_age = graph.op("MatMul", graph.constant(prior.filters, "prior.filters"), by_filter)
    return graph.op("Reshape", by_age, graph.index([prior.memory * columns, units]))


def _gates(graph: Graph, prior: PriorWeights, store: PutMatrix, sizes: Sizes, window: str, schedule: str) -> str:
    both = np.repeat(np.eye(prior.pairs), 2, axis=0)
    newest = graph.slice(window, sizes.window - prior.memory, sizes.window, 0)
    sums = graph.op("MatMul", newest, graph.constant(np.vstack([both, np.zeros(prior.pairs)]), "sums"))
    filtered = graph.op("MatMul", graph.constant(prior.filters.T, "prior.filters"), sums)
    by_sums = graph.op("MatMul", store(graph, "prior.sums"), graph.op("Reshape", filtered, graph.index([-1, 1])))
    by_schedule = graph.op("MatMul", graph.constant(prior.gate, "prior.gate"), schedule)
    return graph.op("Add", graph.op("Tanh", graph.op("Add", by_schedule, by_sums)), graph.constant(1.0))


def _past(graph: Graph, prior: PriorWeights, sizes: Sizes, window: str) -> tuple[str, str]:
    """Add nodes that compute the M rows (y, a) before the present row, (1, M (p + 1)), and the present y, (1, p)."""
    memory, pairs = prior.memory, prior.pairs
    newest = graph.slice(window, sizes.window - memory, sizes.window, 0)
    signs = np.zeros((2 * pairs + 1, pairs + 1))
    for pair in range(pairs):
        signs[2 * pair, pair + 1], signs[2 * pair + 1, pair + 1] = 1.0, -1.0
    signs[-1, 0] = 1.0
    # This product has the rows (a_{k-1}, y_k). When the rows are joined and the first number is removed, y_k and a_k
    # alternate. The present action is missing, because it is not in the window.
    turned = graph.op("MatMul", newest, graph.constant(signs, "differences"))
    size = memory * (pairs + 1)
    row = graph.slice(graph.op("Reshape", turned, graph.index([1, size])), 1, size, 1)
    size -= 1
    known = graph.slice(row, 0, size - pairs, 1)
    oldest = graph.slice(row, 0, pairs + 1, 1)
    now = graph.slice(row, size - pairs, size, 1)
    return graph.op("Concat", oldest, known, axis=1), now
