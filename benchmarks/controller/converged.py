"""The optimum that a control step's few iterations are on the way to: two optimisers, many starts.

The cost has kinks (the maximum and minimum of Cd, |Cl|), where a quasi-Newton method may stop early and Adam with a
constant rate circles. So Adam runs with a rate that falls, L-BFGS-B starts where it ends and at the given plans too,
and the lowest cost found counts. What both find on their own is reported next to it.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import minimize

from contract.arrays import Array
from export.program.controller_program import ControllerProgram
from export.reference.mpc import adam, gradient, plan_cost

FALLING: Final = 3e-3 * 10.0 ** np.linspace(0.0, -2.0, 240)
"""Adam's learning rate falls from 3e-3 to 3e-5: the first half can cross the whole range of actions."""
EVALUATIONS: Final = 200
"""Most evaluations of one L-BFGS-B run: at a kink it would go on without gain."""
BARRIER: Final = 0.01
"""Two plans are in one valley if, on the straight way between them, the cost stays below the higher end plus this share
of the gain."""
_ON_THE_WAY: Final = 9


@dataclass(frozen=True, kw_only=True, eq=False)
class Optimum:
    """What the optimisers reached at one snapshot.

    Attributes:
        plan, cost: the best, (H,).
        scattered: (m, H), where Adam ended from each start, and `scattered_costs` (m,).
        quasi_newton: lowest cost of L-BFGS-B from the given starts alone.
    """

    plan: Array
    cost: float
    scattered: Array
    scattered_costs: Array
    quasi_newton: float


def converged(
    program: ControllerProgram,
    z: Array,
    previous_action: float,
    starts: Array,
    scattered: Array,
    learning_rates: Array = FALLING,
) -> Optimum:
    """Optimise until nothing is gained.

    Args:
        z: latent state (n_z,).
        starts: (s, H), plans for both optimisers.
        scattered: (m, H), more plans for Adam; those reported as `Optimum.scattered`.
    """
    plans = np.vstack([scattered, starts])
    *_, ended = adam(program, z, plans, previous_action, learning_rates)
    ended_costs = plan_cost(program, z, ended, previous_action)
    best = ended[np.argmin(ended_costs)]
    alone = [_quasi_newton(program, z, previous_action, start) for start in starts]
    polished = _quasi_newton(program, z, previous_action, best)
    found = [*alone, polished, (best, float(ended_costs.min()))]
    plan, cost = min(found, key=lambda pair: pair[1])
    return Optimum(
        plan=plan,
        cost=cost,
        scattered=ended[: len(scattered)],
        scattered_costs=ended_costs[: len(scattered)],
        quasi_newton=min(value for _, value in alone),
    )


def valleys(program: ControllerProgram, z: Array, previous_action: float, plans: Array, gain: float) -> int:
    """How many different minima the plans (m, H) are in: without a barrier between them, two count as one."""
    share = np.linspace(0.0, 1.0, _ON_THE_WAY + 2)[:, None]
    centres: list[Array] = []
    for plan in plans:
        for centre in centres:
            way = (1.0 - share) * centre + share * plan
            on_it = plan_cost(program, z, way, previous_action)
            if on_it.max() <= max(on_it[0], on_it[-1]) + BARRIER * gain:
                break
        else:
            centres.append(plan)
    return len(centres)


def _quasi_newton(program: ControllerProgram, z: Array, previous_action: float, start: Array) -> tuple[Array, float]:
    def cost(plan: Array) -> float:
        return float(plan_cost(program, z, plan, previous_action))

    def slope(plan: Array) -> Array:
        return gradient(program, z, plan, previous_action)

    limit = program.action_limit
    found = minimize(
        cost,
        start,
        jac=slope,
        method="L-BFGS-B",
        bounds=[(-limit, limit)] * len(start),
        options={"maxfun": EVALUATIONS, "ftol": 1e-12, "gtol": 1e-9},
    )
    # A run that ends at the limit of evaluations may report the cost of another point than x.
    plan = np.clip(found.x, -limit, limit)
    return plan, cost(plan)
