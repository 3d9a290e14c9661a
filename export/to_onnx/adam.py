"""Fixed-iteration projected Adam as one Scan over the iterations; the gradient is a function given to it."""

from collections.abc import Callable

import numpy as np

from export.program.controller_program import ControllerProgram
from export.program.float32 import float32_within
from export.reference.mpc import ADAM_BETAS, ADAM_EPSILON
from export.to_onnx.graph_builder import Graph


def lower_adam(
    graph: Graph, program: ControllerProgram, plan: str, free_mask: str, gradient: Callable[[Graph, str], str]
) -> str:
    """The optimised plan (H,), from the shifted plan and the mask of free actions.

    Args:
        gradient: writes dJ/da (H,) at a plan (H,) into the body it is given.
    """
    h, mpc = program.mpc.horizon, program.mpc
    beta1, beta2 = ADAM_BETAS
    number = np.arange(1, mpc.iterations + 1)[:, None]
    # lr / (1 - b1^i) and 1 / sqrt(1 - b2^i), one row an iteration.
    learning_rates = graph.constant(mpc.learning_rate / (1.0 - beta1**number), "adam_rate")
    unbias = graph.constant(1.0 / np.sqrt(1.0 - beta2**number), "adam_unbias")
    is_free = graph.op("Greater", free_mask, graph.constant(0.5))
    limit = float32_within(program.action_limit)
    low, high = graph.constant(-limit), graph.constant(limit)

    body = graph.body()
    a, m, v = body.input("plan", (h,)), body.input("m", (h,)), body.input("v", (h,))
    learning_rate, scale = body.input("rate", (1,)), body.input("unbias", (1,))
    g = gradient(body, a)
    m_next = _blend(body, m, g, beta1)
    v_next = _blend(body, v, body.op("Mul", g, g), beta2)
    spread = body.op("Add", body.op("Mul", body.op("Sqrt", v_next), scale), body.constant(ADAM_EPSILON))
    moved = body.op("Sub", a, body.op("Div", body.op("Mul", m_next, learning_rate), spread))
    body.output(body.op("Where", is_free, body.op("Clip", moved, low, high), a), (h,))
    body.output(m_next, (h,))
    body.output(v_next, (h,))

    zero = graph.constant(np.zeros(h))
    optimised, _, _ = graph.scan(body, states=[plan, zero, zero], sequences=[learning_rates, unbias])
    return optimised


def _blend(body: Graph, old: str, new: str, beta: float) -> str:
    return body.op("Add", body.op("Mul", old, body.constant(beta)), body.op("Mul", new, body.constant(1.0 - beta)))
