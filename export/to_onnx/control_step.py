"""`controller.onnx`: one control step in standard ONNX operators (`contract.controller.interface`).

The graph has three parts. The first is the encoder. The second is projected Adam: one Scan over a fixed number of
iterations, whose body has a forward and a backward Scan over the horizon. The third is a roll-out for the result's
forces and cost. Nothing is traced or unrolled, so the number of nodes does not depend on H or the iterations.

The divisors of Adam's moments m and v do not depend on the data, so the Scan over the iterations computes

    M = b1 M + g,    V = b2 V + g^2,    a = a - rate_i M / (sqrt(V) + floor_i),

with M = m / (1 - b1), V = v / (1 - b2), and with c_i = sqrt((1 - b2) / (1 - b2^i))

    rate_i = lr (1 - b1) / ((1 - b1^i) c_i),    floor_i = eps / c_i.

The cost terms and their gradient have the same values as `reference.mpc`, with one matrix for all quadratic terms.
"""

from collections.abc import Callable

import numpy as np
import onnx

from contract.config.controller import MpcConfig
from contract.controller.interface import OUTPUTS, TERMS, Sizes
from export.int8 import Program, effective, precision_of
from export.program.controller_program import ControllerProgram
from export.program.weights import float32_within
from export.reference.mpc import ADAM_BETAS
from export.to_onnx.graph_builder import Graph, store_for
from export.to_onnx.networks import DecoderGraph, DynamicsGraph, lower_encoder
from export.to_onnx.prior import lower_prior, lower_schedule, lower_unknown


def build_controller(lowered: Program) -> onnx.ModelProto:
    """Convert a program to ONNX. A rounded program gives int8 weights, any other program float32 weights; arithmetic is
    in float32. Raises ExportError for a value that float32 cannot hold."""
    store, program = store_for(lowered), effective(lowered)
    shapes = program.sizes.shapes()
    graph = Graph()
    window, plan, free = (graph.input(name, shapes[name]) for name in ("window", "plan", "free"))
    weights = graph.default("weights", program.mpc.weights.as_tuple())
    speed = graph.default("speed", 1.0) if program.knows_speed else None
    reach = graph.constant(float32_within(program.action_limit))
    bound = graph.op("Min", graph.default("limit", float32_within(program.action_limit)), reach)
    dynamics, decoder = DynamicsGraph(graph, program, store), DecoderGraph(graph, program, store)
    start, iterated = shifted(graph, plan, program.mpc.horizon), weights
    if program.prior is not None:
        schedule, share = lower_schedule(graph, weights, speed, graph.op("Div", bound, reach))
        start = lower_prior(
            graph, program.prior, store, program.sizes,
            window=window, committed=start, free=free, schedule=schedule,
            reach=graph.op("Mul", share, reach), bound=bound,
        )  # fmt: skip
        iterated = lower_unknown(graph, weights, knows_goal=program.prior.knows_goal)
    before = previous_action(graph, program.sizes, window)
    cost = Cost(graph, program.mpc, weights, before, start, iterated)
    z = lower_encoder(graph, program, window, store)

    def gradient(body: Graph, candidate: str) -> str:
        rollout = dynamics.rollout(body, z, candidate)
        signed, tapes = decoder.signed_forces(body, rollout.latents)
        to_forces, to_plan = cost.gradient(body, signed, candidate)
        return dynamics.adjoint(body, rollout, decoder.adjoint(body, tapes, to_forces), to_plan)

    optimised = lower_adam(graph, program, start, free, bound, gradient)
    forces = decoder.forces(graph, dynamics.rollout(graph, z, optimised).latents)
    new_plan = graph.op("Squeeze", optimised, graph.index([0]))
    terms = cost.terms(graph, forces, new_plan)
    for name, value in zip(OUTPUTS, (new_plan, forces, terms, cost.total(graph, terms)), strict=True):
        graph.output(value, shapes[name], name)
    return graph.model("stillwake_controller", f"LSTM-MPC control step, {precision_of(lowered)} weights")


def previous_action(graph: Graph, sizes: Sizes, window: str) -> str:
    """Add nodes that read the previous action a_{-1}, (1,), from the last column of the window's last row."""
    last, column = sizes.window - 1, sizes.sensors
    corner = graph.op(
        "Slice", window, graph.index([last, column]), graph.index([last + 1, column + 1]), graph.index([0, 1])
    )
    return graph.op("Reshape", corner, graph.index([1]))


def shifted(graph: Graph, plan: str, horizon: int) -> str:
    """Add nodes that shift the previous plan by one step and repeat its last action; the result is a row (1, H)."""
    rest, last = graph.slice(plan, 1, horizon), graph.slice(plan, horizon - 1, horizon)
    return graph.op("Unsqueeze", graph.op("Concat", rest, last, axis=0), graph.index([0]))


def lower_adam(
    graph: Graph, program: ControllerProgram, plan: str, free: str, bound: str, gradient: Callable[[Graph, str], str]
) -> str:
    """Add nodes that compute the optimised plan (1, H) from the starting plan (1, H), the mask of free actions (H,) and
    the scalar bound on |a|. `gradient` adds to a Scan's body the nodes that compute dJ/da (1, H) at a plan (1, H)."""
    h, mpc = program.mpc.horizon, program.mpc
    beta1, beta2 = ADAM_BETAS
    number = np.arange(1, mpc.iterations + 1)[:, None]
    spread_scale = np.sqrt((1.0 - beta2) / (1.0 - beta2**number))
    mean_scale = (1.0 - beta1) / (1.0 - beta1**number)
    rates = graph.constant(mpc.learning_rate * mean_scale / spread_scale, "adam_rate")
    floors = graph.constant(mpc.epsilon / spread_scale, "adam_floor")
    is_free = graph.op("Greater", free, graph.constant(0.5))
    lowest = graph.op("Sub", graph.constant(0.0), bound)

    body = graph.body()
    a, m, v = (body.input(name, (1, h)) for name in ("plan", "m", "v"))
    rate, floor = body.input("rate", (1,)), body.input("floor", (1,))
    g = gradient(body, a)
    m_next = _decayed(body, m, g, beta1)
    v_next = _decayed(body, v, body.op("Mul", g, g), beta2)
    spread = body.op("Add", body.op("Sqrt", v_next), floor)
    moved = body.op("Sub", a, body.op("Div", body.op("Mul", m_next, rate), spread))
    body.output(body.op("Where", is_free, body.op("Clip", moved, lowest, bound), a), (1, h))
    body.output(m_next, (1, h))
    body.output(v_next, (1, h))

    zero = graph.constant(np.zeros((1, h)))
    optimised, _, _ = graph.scan(body, states=[plan, zero, zero], sequences=[rates, floors])
    return optimised


def _decayed(body: Graph, old: str, new: str, beta: float) -> str:
    return body.op("Add", body.op("Mul", old, body.constant(beta)), new)


class Cost:
    """The cost J for given weights (8,) and previous action (1,), which are values of the outermost graph. `start` is
    the plan (1, H) from which the optimiser starts; `iterated` has the weights (8,) of the terms in the gradient."""

    def __init__(
        self, graph: Graph, mpc: MpcConfig, weights: str, previous_action: str, start: str, iterated: str
    ) -> None:
        self._horizon, self._previous_action, self._weights, self._start = mpc.horizon, previous_action, weights, start
        pieces = graph.ops("Split", iterated, graph.index([1] * len(TERMS)), outputs=len(TERMS))
        self._weight = dict(zip(TERMS, pieces, strict=True))
        self._drag_reference = graph.constant([mpc.drag_reference], "drag_reference")
        self._prepare(graph, start)

    def terms(self, graph: Graph, forces: str, plan: str) -> str:
        """Add nodes that compute the unweighted terms, (8,)."""
        h, column = self._horizon, graph.index([1])
        columns = graph.ops("Split", forces, graph.index([1, 1]), outputs=2, axis=1)
        cd, cl = (graph.op("Squeeze", one, column) for one in columns)
        mean_lift = _reduce(graph, "ReduceMean", cl)
        increments = graph.op("Sub", graph.slice(plan, 1, h), graph.slice(plan, 0, h - 1))
        start = graph.op("Reshape", self._start, graph.index([h]))
        terms = {
            "drag_mean": graph.op("Sub", _reduce(graph, "ReduceMean", cd), self._drag_reference),
            "drag_fluctuation": graph.op("Sub", _reduce(graph, "ReduceMax", cd), _reduce(graph, "ReduceMin", cd)),
            "lift": _reduce(graph, "ReduceMean", graph.op("Abs", cl)),
            "lift_mean": _square(graph, mean_lift),
            "smoothness": _reduce(graph, "ReduceMean", _square(graph, increments)),
            "effort": _reduce(graph, "ReduceMean", _square(graph, plan)),
            "rate": _square(graph, graph.op("Sub", graph.slice(plan, 0, 1), self._previous_action)),
            "prior": _reduce(graph, "ReduceMean", _square(graph, graph.op("Sub", plan, start))),
        }
        return graph.op("Concat", *(terms[name] for name in TERMS), axis=0)

    def total(self, graph: Graph, terms: str) -> str:
        """Add nodes that compute J, a scalar."""
        return graph.op("ReduceSum", graph.op("Mul", self._weights, terms), keepdims=0)

    def gradient(self, graph: Graph, signed_forces: str, plan: str) -> tuple[str, str]:
        """Add nodes that compute the same gradient as `reference.mpc.cost_gradient`: dJ/d(Cd, -Cd, Cl), (H, 3), and
        dJ/da at fixed forces, (1, H). `signed_forces` (H, 3) has the columns Cd, -Cd and Cl; `plan` is (1, H). The
        drag's fluctuation is max Cd - min Cd = max Cd + max(-Cd), so only maxima are needed."""
        # The gradient is 1 at the largest value of a column; several equal largest values share the gradient evenly.
        ties = graph.op("Cast", graph.op("Equal", signed_forces, _reduce(graph, "ReduceMax", signed_forces)), to=1)
        share = graph.op("Div", ties, _reduce(graph, "ReduceSum", ties))
        fluctuation = graph.op("Mul", share, self._by_maximum)
        lift = graph.op("Mul", graph.op("Sign", signed_forces), self._by_sign)
        mean = graph.op("Mul", _reduce(graph, "ReduceMean", signed_forces), self._by_mean)
        steady = graph.op("Add", mean, self._by_drag)
        through_forces = graph.op("Add", graph.op("Add", fluctuation, lift), steady)
        # In ONNX Runtime, a matrix times a column takes three times as long as a row times a matrix.
        return through_forces, graph.op("Gemm", plan, self._curvature, self._minus_pull)

    def _prepare(self, graph: Graph, start: str) -> None:
        """Add the nodes for the parts of the gradient that depend only on the weights, the previous action and the plan
        p from which the optimiser starts. The terms in the plan a are quadratic. With increments D a and the unit
        vector e_0, their gradient is Q a - q,

            Q = 2 w_smoothness D^T D / (H - 1) + 2 (w_effort + w_prior) I / H + 2 w_rate e_0 e_0^T,
            q = 2 w_rate a_{-1} e_0 + 2 w_prior p / H.
        """
        h = self._horizon
        increments = np.diff(np.eye(h), axis=0)
        first = np.eye(h)[0]
        quadratic = {
            "smoothness": 2.0 / (h - 1) * increments.T @ increments,
            "effort": 2.0 / h * np.eye(h),
            "rate": 2.0 * np.outer(first, first),
            "prior": 2.0 / h * np.eye(h),
        }
        weighted = [
            graph.op("Mul", graph.constant(matrix, f"curvature.{name}"), self._weight[name])
            for name, matrix in quadratic.items()
        ]
        self._curvature = graph.op("Sum", *weighted)
        rate = graph.op("Mul", self._weight["rate"], self._previous_action)
        to_previous = graph.op("Mul", graph.constant(-2.0 * first, "first"), rate)
        prior = graph.op("Mul", self._weight["prior"], graph.constant([-2.0 / h]))
        self._minus_pull = graph.op("Add", to_previous, graph.op("Mul", start, prior))
        # The entries of these rows (3,) are for Cd, -Cd and Cl.
        self._by_maximum = graph.op("Mul", self._weight["drag_fluctuation"], graph.constant([1.0, 1.0, 0.0]))
        self._by_drag = graph.op("Mul", self._weight["drag_mean"], graph.constant([1.0 / h, 0.0, 0.0]))
        self._by_sign = graph.op("Mul", self._weight["lift"], graph.constant([0.0, 0.0, 1.0 / h]))
        self._by_mean = graph.op("Mul", self._weight["lift_mean"], graph.constant([0.0, 0.0, 2.0 / h]))


def _reduce(graph: Graph, kind: str, x: str) -> str:
    return graph.op(kind, x, graph.index([0]), keepdims=1)


def _square(graph: Graph, x: str) -> str:
    return graph.op("Mul", x, x)
