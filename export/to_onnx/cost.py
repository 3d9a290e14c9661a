"""The cost terms and their gradient as ONNX nodes. They compute the same values as `reference.mpc`, with one matrix
for all quadratic terms."""

import numpy as np

from contract.config.controller import MpcConfig
from contract.controller.interface import TERMS
from export.to_onnx.graph_builder import Graph


class Cost:
    """The cost J for given weights (8,) and previous action (1,), which are values of the outermost graph. `start` is
    the plan (1, H) from which the optimiser starts; `iterated` has the weights (8,) for the gradient."""

    def __init__(
        self, graph: Graph, mpc: MpcConfig, weights: str, previous_action: str, start: str, iterated: str
    ) -> None:
        self._horizon = mpc.horizon
        self._previous_action = previous_action
        self._weights = weights
        self._start = start
        # The Split gives the weight of each term as a value of shape (1,).
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
        dJ/da at fixed forces, (1, H). `signed_forces`, shape (H, 3), has the columns Cd, -Cd and Cl; `plan` has the
        shape (1, H).

        The drag's fluctuation is max Cd - min Cd = max Cd + max(-Cd). Because -Cd has a column of its own, only maxima
        are needed, and the same nodes serve all columns.
        """
        # The gradient is 1 at the largest value of a column; several equal largest values share the gradient evenly.
        ties = graph.op("Cast", graph.op("Equal", signed_forces, _reduce(graph, "ReduceMax", signed_forces)), to=1)
        share = graph.op("Div", ties, _reduce(graph, "ReduceSum", ties))
        fluctuation = graph.op("Mul", share, self._by_maximum)
        lift = graph.op("Mul", graph.op("Sign", signed_forces), self._by_sign)
        mean = graph.op("Mul", _reduce(graph, "ReduceMean", signed_forces), self._by_mean)
        steady = graph.op("Add", mean, self._by_drag)
        through_forces = graph.op("Add", graph.op("Add", fluctuation, lift), steady)
        # The plan is a row, because in ONNX Runtime a matrix times a column takes three times as long as a row times a
        # matrix.
        return through_forces, graph.op("Gemm", plan, self._curvature, self._minus_pull)

    def _prepare(self, graph: Graph, start: str) -> None:
        """Add the nodes for the parts of the gradient that depend only on the weights, the previous action and the
        start p. These nodes run once per control step.

        The terms in the plan a are quadratic. With increments D and first unit vector e_0 their gradient is Q a - q,

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
