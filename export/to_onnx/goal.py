"""The goal of a control step as ONNX nodes: what schedules a prior, and what it leaves to the iterations.

See `contract.controller.goal`, whose functions these are for weights (8,) and a bound () on |a|.
"""

import numpy as np

from contract.controller.goal import DEAREST_EFFORT, DEAREST_LIFT, NARROWEST, SPEED_SCALE
from contract.controller.interface import TERMS
from export.to_onnx.graph_builder import Graph


def lower_schedule(graph: Graph, weights: str, speed: str | None, share: str) -> tuple[str, str]:
    """The schedule (5, 1), and how far the goal lets the jets go as a share of the program's limit, ().

    Args:
        speed: (); None where the prior does not know it.
        share: (), the bound on |a| as a share of the program's limit, at most 1.
    """
    row = graph.index([1])
    drag, effort, lift = (
        graph.slice(weights, place, place + 1) for place in map(TERMS.index, ("drag_mean", "effort", "lift"))
    )
    asked = graph.op("Concat", effort, lift, axis=0)
    dearest = graph.op("Mul", drag, graph.constant([DEAREST_EFFORT, DEAREST_LIFT]))
    root = graph.op("Sqrt", graph.op("Div", asked, dearest))
    # A cost without drag divides by zero here, and takes the other side.
    any_at_all = graph.op("Cast", graph.op("Greater", asked, graph.constant(0.0)), to=1)
    prices = graph.op("Where", graph.op("Greater", dearest, asked), root, any_at_all)
    one, zero = graph.constant(1.0), graph.constant(0.0)
    scale = graph.constant(1.0 / (1.0 - NARROWEST))
    narrowed = graph.op("Min", graph.op("Mul", graph.op("Sub", one, share), scale), one)
    faster = zero if speed is None else graph.op("Div", graph.op("Sub", speed, one), graph.constant(SPEED_SCALE))
    beside = [graph.op("Reshape", value, row) for value in (faster, narrowed)]
    parts = graph.constant([1.0]), beside[0], prices, beside[1]
    schedule = graph.op("Unsqueeze", graph.op("Concat", *parts, axis=0), row)
    reach = graph.op("Sub", one, graph.op("Mul", narrowed, graph.constant(1.0 - NARROWEST)))
    return schedule, reach


def lower_beyond(graph: Graph, weights: str, *, knows_goal: bool) -> str:
    """The weights (8,) of the iterations behind a prior, which knows a goal or drag alone."""
    known, kept = np.zeros(len(TERMS)), np.ones(len(TERMS))
    if knows_goal:
        known[[TERMS.index("effort"), TERMS.index("lift")]] = DEAREST_EFFORT, DEAREST_LIFT
    kept[TERMS.index("drag_mean")] = 0.0
    drag = graph.slice(weights, TERMS.index("drag_mean"), TERMS.index("drag_mean") + 1)
    rest = graph.op("Sub", weights, graph.op("Mul", drag, graph.constant(known, "known")))
    return graph.op("Mul", graph.op("Relu", rest), graph.constant(kept, "kept"))
