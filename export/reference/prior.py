"""The prior of the plan in NumPy float64, which is the specification of the prior's lowerings.

The plan consists of the outputs of a feedback over the horizon. The feedback was trained with gradients through the
flow (`train.refinement`). In the horizon, an autoregressive model predicts the feedback's inputs. With rows (y_i, a_i)
of the sensor pairs' pressure differences and the action, a past of M rows, and the schedule s = (1, slower, faster,
effort, lift, limit) of the present speed and goal (`contract.controller.goal`),

    g = 1 + tanh(gate s + sums . filters^T (Cp_first + Cp_second, rows t-M+1 .. t)),
    a_{t+k} = clip(r A tanh(output . (g tanh((sum_j s_j first_j) . filters^T rows t+k-M .. t+k-1)))),
    y_{t+k+1} = predictor . rows t+k-M+1 .. t+k,

where A is the program's bound on |a| and r A the bound that the goal allows; clip applies this control step's limit.
Committed actions do not change. The present schedule and gates apply over the whole horizon, because the distance of
the wake from the steady wake changes over many shedding cycles. The feedback does not read the row of its own step: on
the vehicle, and in training, the command computed from the pressures of t acts in period t+1. So only the next period's
action needs no predicted row. With a delayed actuator, every action needs predicted rows.
"""

import numpy as np

from contract.arrays import Array
from contract.controller.goal import OWN, Goal, schedule
from export.program.weights import PriorWeights


def prior_plan(
    prior: PriorWeights,
    window: Array,
    committed: Array,
    free: Array,
    reach: float,
    speed: float = 1.0,
    goal: Goal = OWN,
    limit: float = np.inf,
) -> Array:
    """Compute the plan (H,) from which the optimiser starts, from a window (L, S+1) of rows (Cp_k, a_{k-1}), oldest
    first; L is at least the prior's memory. `committed` (H,) are the plan's actions; they apply where `free` (H,) is 0,
    and the prior decides where it is 1. `reach` is A, the program's bound on |a|, and `limit` the bound in this control
    step, both in U_inf W. `speed` is the vehicle's, as a ratio to the design speed."""
    past, y = past_of(window, prior.memory)
    scheduled = np.array(schedule(speed, goal))
    hidden = np.tensordot(scheduled, prior.first, axes=1)
    by_sums = np.tensordot(prior.sums, filtered_sums(prior, window), axes=2)
    gates = 1.0 + np.tanh(prior.gate @ scheduled + by_sums)
    plan = []
    for k, action in enumerate(committed):
        if free[k] > 0.5:
            units = gates * np.tanh(np.tensordot(hidden, prior.filters.T @ past, axes=2))
            action = np.clip(goal.share_of_limit() * reach * np.tanh(prior.output @ units), -limit, limit)
        plan.append(action)
        past = np.vstack([past[1:], [*y, action]])
        y = np.tensordot(prior.predictor, past, axes=2)
    return np.array(plan)


def filtered_sums(prior: PriorWeights, window: Array) -> Array:
    """Compute the filtered sums of the p pairs, (F, p) for F filters, over M rows up to the present row."""
    newest = window[-prior.memory :]
    return np.asarray(prior.filters.T @ (newest[:, :-1:2] + newest[:, 1:-1:2]))


def past_of(window: Array, memory: int) -> tuple[Array, Array]:
    """Return the M rows (y_i, a_i) before the present row, (M, p + 1), and the present pressure differences y_t, (p,).
    The window does not contain the oldest of these rows, so a copy of the second-oldest row is used in its place."""
    newest = window[-memory:]
    # In the window, a row has the action that precedes the row's pressures. The present action is not yet decided.
    rows = np.column_stack([newest[:, :-1:2] - newest[:, 1:-1:2], np.append(newest[1:, -1], 0.0)])
    return np.vstack([rows[:1], rows[:-1]]), rows[-1, :-1]
