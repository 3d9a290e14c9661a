"""The prior of the plan in NumPy float64: the specification of its lowerings.

A feedback that was trained through the flow (`train.refinement`) is followed over the horizon, on differences that an
autoregressive model predicts. With rows (y_i, a_i) of the sensors' differences and the action, and a past of M rows,

    a_{t+k} = limit tanh(output . tanh((first + (speed - 1) slope) . filters^T rows t+k-M .. t+k-1)),
    y_{t+k+1} = predictor . rows t+k-M+1 .. t+k,

where an action that is committed stands as it is. The speed is the vehicle's over the design speed, over the whole
horizon. The feedback does not read the row of its own step, because on the
vehicle the command that is made from the pressures of t acts in period t+1, which is how it was trained. So a plan that
is made a period ahead needs no prediction; a late actuator, and what the horizon has beyond it, do.
"""

import numpy as np

from contract.arrays import Array
from export.program.weights import PriorWeights


def prior_plan(
    prior: PriorWeights, window: Array, committed: Array, free: Array, limit: float, speed: float = 1.0
) -> Array:
    """The plan (H,) that the optimiser starts from.

    Args:
        window: (L, S+1) rows (Cp_k, a_{k-1}), oldest first; L is at least the prior's memory.
        committed: (H,) the actions where they are not free.
        free: (H,) 1 where the prior decides.
        limit: bound on |a|, in U_inf W.
        speed: of the vehicle, as a ratio to the design speed.
    """
    past, y = past_of(window, prior.memory)
    hidden = prior.first + (speed - 1.0) * prior.slope
    plan = []
    for k, action in enumerate(committed):
        if free[k] > 0.5:
            units = np.tanh(np.tensordot(hidden, prior.filters.T @ past, axes=2))
            action = limit * np.tanh(prior.output @ units)
        plan.append(action)
        past = np.vstack([past[1:], [*y, action]])
        y = np.tensordot(prior.predictor, past, axes=2)
    return np.array(plan)


def past_of(window: Array, memory: int) -> tuple[Array, Array]:
    """Rows (y_i, a_i), (M, p + 1), before the present one, and the differences y_t, (p,), of the present one.

    The window does not hold the oldest of them, which is taken to be like the one after it.
    """
    newest = window[-memory:]
    # Each pressure's row has the action before it. The last action is not decided yet.
    rows = np.column_stack([newest[:, :-1:2] - newest[:, 1:-1:2], np.append(newest[1:, -1], 0.0)])
    return np.vstack([rows[:1], rows[:-1]]), rows[-1, :-1]
