"""The cost terms and their gradient as ONNX nodes: `reference_cost`, operator by operator."""

from dataclasses import dataclass

from export.graph_builder import Graph
from export.program import ControllerProgram
from export.reference_cost import TERMS


@dataclass(frozen=True, kw_only=True)
class CostGradientNames:
    """dJ/dforces (H, 2), and dJ/da (H,) with the forces held fixed."""

    forces: str
    plan: str


class Cost:
    """J for given weights (7,) and action in force (1,); both are values of the outermost graph."""

    def __init__(self, graph: Graph, program: ControllerProgram, weights: str, previous_action: str) -> None:
        self._horizon = program.mpc.horizon
        self._previous_action = previous_action
        self._weights = weights
        # One value of shape (1,) per term.
        pieces = graph.ops("Split", weights, graph.index([1] * len(TERMS)), outputs=len(TERMS))
        self._weight = dict(zip(TERMS, pieces, strict=True))
        self._drag_reference = graph.constant([program.mpc.drag_reference], "drag_reference")

    def terms(self, graph: Graph, forces: str, plan: str) -> str:
        """The unweighted terms, (7,)."""
        cd, cl = self._drag_and_lift(graph, forces)
        mean_lift = _reduce(graph, "ReduceMean", cl)
        first = graph.op("Slice", plan, graph.index([0]), graph.index([1]))
        terms = {
            "drag_mean": graph.op("Sub", _reduce(graph, "ReduceMean", cd), self._drag_reference),
            "drag_fluctuation": graph.op("Sub", _reduce(graph, "ReduceMax", cd), _reduce(graph, "ReduceMin", cd)),
            "lift": _reduce(graph, "ReduceMean", graph.op("Abs", cl)),
            "lift_mean": _square(graph, mean_lift),
            "smoothness": _reduce(graph, "ReduceMean", _square(graph, self._increments(graph, plan))),
            "effort": _reduce(graph, "ReduceMean", _square(graph, plan)),
            "rate": _square(graph, graph.op("Sub", first, self._previous_action)),
        }
        return graph.op("Concat", *(terms[name] for name in TERMS), axis=0)

    def total(self, graph: Graph, terms: str) -> str:
        """J, a scalar."""
        return graph.op("ReduceSum", graph.op("Mul", self._weights, terms), keepdims=0)

    def gradient(self, graph: Graph, forces: str, plan: str) -> CostGradientNames:
        """As `reference_cost.cost_gradient`."""
        h = self._horizon
        cd, cl = self._drag_and_lift(graph, forces)
        per_step = graph.constant([1.0 / h])

        spread = graph.op("Sub", _share(graph, cd, "ReduceMax"), _share(graph, cd, "ReduceMin"))
        d_cd = graph.op(
            "Add",
            graph.op("Mul", spread, self._weight["drag_fluctuation"]),
            graph.op("Mul", self._weight["drag_mean"], per_step),
        )
        steady = graph.op("Mul", _reduce(graph, "ReduceMean", cl), self._twice("lift_mean", graph, 1.0 / h))
        d_cl = graph.op(
            "Add", graph.op("Mul", graph.op("Sign", cl), graph.op("Mul", self._weight["lift"], per_step)), steady
        )
        column = graph.index([1])
        d_forces = graph.op("Concat", graph.op("Unsqueeze", d_cd, column), graph.op("Unsqueeze", d_cl, column), axis=1)
        return CostGradientNames(forces=d_forces, plan=self._plan_gradient(graph, plan))

    def _plan_gradient(self, graph: Graph, plan: str) -> str:
        h = self._horizon
        pull = graph.op("Mul", self._increments(graph, plan), self._twice("smoothness", graph, 1.0 / (h - 1)))
        # (a_{k+1} - a_k)^2 pulls a_{k+1} by the increment and a_k by its opposite.
        smoothness = graph.op(
            "Sub",
            graph.op("Pad", pull, graph.index([1, 0])),
            graph.op("Pad", pull, graph.index([0, 1])),
        )
        effort = graph.op("Mul", plan, self._twice("effort", graph, 1.0 / h))
        first = graph.op("Slice", plan, graph.index([0]), graph.index([1]))
        step = graph.op("Mul", graph.op("Sub", first, self._previous_action), self._twice("rate", graph, 1.0))
        rate = graph.op("Pad", step, graph.index([0, h - 1]))
        return graph.op("Add", graph.op("Add", smoothness, effort), rate)

    def _twice(self, name: str, graph: Graph, factor: float) -> str:
        return graph.op("Mul", self._weight[name], graph.constant([2.0 * factor]))

    def _increments(self, graph: Graph, plan: str) -> str:
        h = self._horizon
        return graph.op(
            "Sub",
            graph.op("Slice", plan, graph.index([1]), graph.index([h])),
            graph.op("Slice", plan, graph.index([0]), graph.index([h - 1])),
        )

    def _drag_and_lift(self, graph: Graph, forces: str) -> tuple[str, str]:
        cd, cl = graph.ops("Split", forces, graph.index([1, 1]), outputs=2, axis=1)
        column = graph.index([1])
        return graph.op("Squeeze", cd, column), graph.op("Squeeze", cl, column)


def _reduce(graph: Graph, kind: str, x: str) -> str:
    return graph.op(kind, x, graph.index([0]), keepdims=1)


def _square(graph: Graph, x: str) -> str:
    return graph.op("Mul", x, x)


def _share(graph: Graph, x: str, kind: str) -> str:
    # 1 at the extreme value; a tie shares it evenly.
    ties = graph.op("Cast", graph.op("Equal", x, _reduce(graph, kind, x)), to=1)
    return graph.op("Div", ties, _reduce(graph, "ReduceSum", ties))
