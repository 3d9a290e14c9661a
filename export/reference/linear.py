"""One control step of a linear controller in NumPy float64: the specification of its lowerings.

The model is rolled out over the horizon. At each step the action is the one that the shifted plan has committed, or,
where it is free, the state feedback at the state that is predicted for then, within the limit:

    a_{t+k} = clip(gain . x_{t+k}),    (y_{t+k+1}, Cl_{t+k+1}) = model . (x_{t+k}, a_{t+k})

With a delay of d steps the first d actions are committed, and what is decided is the feedback at the predicted state:
for a linear model and a quadratic cost that is the optimal regulator with delay. Cd is the mean of the identification.
"""

import numpy as np

from contract.arrays import Array
from contract.controller.interface import ControlStep
from export.program.linear_program import LinearProgram
from export.reference.cost import cost_terms
from export.reference.history import history_of
from export.reference.mpc import shift


def linear_control_step(
    program: LinearProgram, window: Array, plan: Array, free: Array, weights: Array | None = None
) -> ControlStep:
    """What `controller.onnx` computes; arguments as in `contract.controller.interface`.

    Args:
        window: (L, S+1) rows (Cp_k, a_{k-1}), oldest first.
        plan: (H,) the previous step's plan as it came out.
        free: (H,) 1 where the shifted plan may be changed, 0 where it is committed.
        weights: (8,) cost weights, the program's if None: of the cost that is reported, on which no action depends.
    """
    history = history_of(window)
    committed = shift(plan)
    actions, lifts = [], []
    for k in range(program.mpc.horizon):
        action = float(np.clip((program.gain * history).sum(), -program.action_limit, program.action_limit))
        if free[k] <= 0.5:
            action = float(committed[k])
        history[-1, -1] = action
        *y, lift = np.tensordot(program.model, history, axes=2)
        actions.append(action)
        lifts.append(lift)
        history = np.vstack([history[1:], [*y, 0.0]])
    forces = np.column_stack([np.full(len(lifts), program.scaling.force_mean[0]), lifts])
    new_plan = np.array(actions)
    terms = cost_terms(forces, new_plan, float(window[-1, -1]), program.mpc.drag_reference)
    used = np.array(program.mpc.weights.as_tuple()) if weights is None else weights
    return ControlStep(plan=new_plan, forces=forces, terms=terms, cost=float(terms @ used))
