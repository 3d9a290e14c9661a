"""Fixed-iteration projected Adam as one Scan over the iterations; the gradient is a function given to it.

What the moments m and v are divided by does not depend on the data, so the Scan holds

    M = b1 M + g,    V = b2 V + g^2,    a = a - rate_i M / (sqrt(V) + floor_i),

with M = m / (1 - b1), V = v / (1 - b2), and with c_i = sqrt((1 - b2) / (1 - b2^i))

    rate_i = lr (1 - b1) / ((1 - b1^i) c_i),    floor_i = eps / c_i.
"""

from collections.abc import Callable

import numpy as np

from export.program.controller_program import ControllerProgram
from export.reference.mpc import ADAM_BETAS
from export.to_onnx.graph_builder import Graph


def lower_adam(
    graph: Graph,
    program: ControllerProgram,
    plan: str,
    free_mask: str,
    bound: str,
    gradient: Callable[[Graph, str], str],
) -> str:
    """The optimised plan (1, H), from the plan (1, H) to start at, the mask of free actions (H,) and the bound on |a|,
    (). `gradient` writes dJ/da (1, H) at a plan (1, H) into the body it is given."""
    h, mpc = program.mpc.horizon, program.mpc
    beta1, beta2 = ADAM_BETAS
    number = np.arange(1, mpc.iterations + 1)[:, None]
    # One row an iteration.
    spread_scale = np.sqrt((1.0 - beta2) / (1.0 - beta2**number))
    mean_scale = (1.0 - beta1) / (1.0 - beta1**number)
    rates = graph.constant(mpc.learning_rate * mean_scale / spread_scale, "adam_rate")
    floors = graph.constant(mpc.epsilon / spread_scale, "adam_floor")
    is_free = graph.op("Greater", free_mask, graph.constant(0.5))
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
