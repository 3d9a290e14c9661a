"""`controller.onnx`: one control step in standard ONNX operators (`contract.controller.interface`).

Encoder, then a Scan over Adam's iterations whose body holds a Scan forwards and a Scan backwards over the
horizon, then one more roll-out for the forces and the cost of the result. Written from the hand adjoint of
`export.reference.mpc`; nothing is traced or unrolled, so the number of nodes does not depend on H or the iterations.
"""

import onnx

from contract.controller.interface import OUTPUTS, Sizes
from export.int8.rounded_program import Program, effective, precision_of
from export.program.float32 import float32_within
from export.to_onnx.adam import lower_adam
from export.to_onnx.cost import Cost
from export.to_onnx.decoder import Decoder
from export.to_onnx.dynamics import Dynamics
from export.to_onnx.encoder import lower_encoder
from export.to_onnx.goal import lower_beyond, lower_schedule
from export.to_onnx.graph_builder import Graph
from export.to_onnx.prior import lower_prior
from export.to_onnx.weights import store_for


def build_controller(lowered: Program) -> onnx.ModelProto:
    """Lower a program to ONNX, a rounded one with its int8 weights; arithmetic is float32 in either. Raises ExportError
    for a value that float32 cannot hold."""
    store, program = store_for(lowered), effective(lowered)
    shapes = program.sizes.shapes()
    graph = Graph()
    window, plan, free = (graph.input(name, shapes[name]) for name in ("window", "plan", "free"))
    weights = graph.default("weights", program.mpc.weights.as_tuple())
    speed = graph.default("speed", 1.0) if program.knows_speed else None
    reach = graph.constant(float32_within(program.action_limit))
    bound = graph.op("Min", graph.default("limit", float32_within(program.action_limit)), reach)

    dynamics, decoder = Dynamics(graph, program, store), Decoder(graph, program, store)
    start, iterated = shifted(graph, plan, program.mpc.horizon), weights
    if program.prior is not None:
        schedule, share = lower_schedule(graph, weights, speed, graph.op("Div", bound, reach))
        start = lower_prior(
            graph, program.prior, store, program.sizes,
            window=window, committed=start, free=free, schedule=schedule,
            reach=graph.op("Mul", share, reach), bound=bound,
        )  # fmt: skip
        iterated = lower_beyond(graph, weights, knows_goal=program.prior.knows_goal)
    before = previous_action(graph, program.sizes, window)
    cost = Cost(graph, program.mpc, weights, before, start, iterated)
    z = lower_encoder(graph, program, window, store)

    def gradient(body: Graph, candidate: str) -> str:
        rollout = dynamics.rollout(body, z, candidate)
        signed, tapes = decoder.signed_forces(body, rollout.latents)
        local = cost.gradient(body, signed, candidate)
        through_forces = decoder.adjoint(body, tapes, local.signed_forces)
        return dynamics.adjoint(body, rollout, through_forces, local.plan)

    optimised = lower_adam(graph, program, start, free, bound, gradient)
    forces = decoder.forces(graph, dynamics.rollout(graph, z, optimised).latents)
    new_plan = graph.op("Squeeze", optimised, graph.index([0]))
    terms = cost.terms(graph, forces, new_plan)
    for name, value in zip(OUTPUTS, (new_plan, forces, terms, cost.total(graph, terms)), strict=True):
        graph.output(value, shapes[name], name)
    return graph.model("stillwake_controller", f"LSTM-MPC control step, {precision_of(lowered)} weights")


def previous_action(graph: Graph, sizes: Sizes, window: str) -> str:
    """a_{-1}, the last row's last column, as (1,)."""
    last, column = sizes.window - 1, sizes.sensors
    corner = graph.op(
        "Slice", window, graph.index([last, column]), graph.index([last + 1, column + 1]), graph.index([0, 1])
    )
    return graph.op("Reshape", corner, graph.index([1]))


def shifted(graph: Graph, plan: str, horizon: int) -> str:
    """The previous plan one step later, its last action repeated, as a row (1, H)."""
    rest, last = graph.slice(plan, 1, horizon), graph.slice(plan, horizon - 1, horizon)
    return graph.op("Unsqueeze", graph.op("Concat", rest, last, axis=0), graph.index([0]))
