"""A linear controller's `controller.onnx`: one Scan over the horizon (`export.reference.linear`).

The history is one row, oldest difference first. Model and gain stand side by side in one matrix, so that a step of the
horizon is one product: the gain's part of it is the action that the feedback wants, and what the action itself changes
is added after it is known.
"""

import numpy as np
import onnx

from contract.controller.interface import OUTPUTS
from export.program.float32 import float32_within
from export.program.linear_program import LinearProgram
from export.to_onnx.control_step import previous_action, shifted
from export.to_onnx.cost import Cost
from export.to_onnx.graph_builder import Graph
from export.to_onnx.history import lower_history


def build_linear_controller(program: LinearProgram) -> onnx.ModelProto:
    """Lower a linear program to ONNX in float32. Raises ExportError for a value that float32 cannot hold."""
    shapes, h, columns = program.sizes.shapes(), program.mpc.horizon, program.pairs + 1
    graph = Graph()
    window, plan, free = (graph.input(name, shapes[name]) for name in ("window", "plan", "free"))
    weights = graph.default("weights", program.mpc.weights.as_tuple())
    cost = Cost(graph, program.mpc, weights, previous_action(graph, program.sizes, window))

    length = program.window * columns
    rows = np.concatenate([program.model.reshape(columns, length), program.gain.reshape(1, length)])
    products = graph.constant(rows[:, :-1].T, "model and gain")
    by_action = graph.constant(rows[None, :-1, -1], "model by action")
    limit = float32_within(program.action_limit)
    low, high = graph.constant(-limit), graph.constant(limit)

    body = graph.body()
    state = body.input("history", (1, length - 1))
    committed, chosen = body.input("committed", (1,)), body.input("free", (1,))
    product = body.op("MatMul", state, products)
    predicted, wanted = body.ops("Split", product, body.index([columns, 1]), outputs=2, axis=1)
    decide = body.op("Greater", chosen, body.constant(0.5))
    action = body.op("Where", decide, body.op("Clip", wanted, low, high), committed)
    after = body.op("Add", predicted, body.op("Mul", action, by_action))
    y, lift = body.ops("Split", after, body.index([columns - 1, 1]), outputs=2, axis=1)
    kept = body.slice(state, columns, length - 1, 1)
    body.output(body.op("Concat", kept, action, y, axis=1), (1, length - 1))
    body.output(action, (1, 1))
    body.output(lift, (1, 1))

    by_step = [_column(graph, value, h) for value in (shifted(graph, plan, h), free)]
    history = lower_history(graph, window, program.window, program.pairs)
    _, actions, lifts = graph.scan(body, states=[history], sequences=by_step)
    new_plan = graph.op("Reshape", actions, graph.index([h]))
    drag = graph.constant(np.full((h, 1), program.scaling.force_mean[0]), "mean drag")
    forces = graph.op("Concat", drag, graph.op("Reshape", lifts, graph.index([h, 1])), axis=1)
    terms = cost.terms(graph, forces, new_plan)
    for name, value in zip(OUTPUTS, (new_plan, forces, terms, cost.total(graph, terms)), strict=True):
        graph.output(value, shapes[name], name)
    return graph.model("stillwake_controller", "linear state feedback control step, float32")


def _column(graph: Graph, values: str, horizon: int) -> str:
    return graph.op("Reshape", values, graph.index([horizon, 1]))
