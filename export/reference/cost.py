"""The MPC's cost as separate, named terms with hand-written gradients (paper, equations 12-15), in float64.

J = sum over terms of weight * term, in physical units. The terms depend on the predicted forces (Cd_k, Cl_k) at t+1 ..
t+H, shape (..., H, 2), on the plan a_0 .. a_{H-1}, shape (..., H), on the plan p from which the optimiser started, and
on the previous action a_{-1}, shape (...,) or a single number:

================  =======================================================
drag_mean         mean Cd - Cd_ref
drag_fluctuation  max Cd - min Cd
lift              mean |Cl|
lift_mean         (mean Cl)^2
smoothness        sum over k = 0 .. H-2 of (a_{k+1} - a_k)^2 / (H - 1)
effort            mean a^2
rate              (a_0 - a_{-1})^2
prior             mean (a - p)^2
================  =======================================================

Where a term has a kink, its gradient is the subgradient that PyTorch uses: equal maxima or minima share it
evenly, and |Cl| has slope 0 at 0.
"""

from dataclasses import dataclass

import numpy as np

from contract.arrays import Array
from contract.controller.interface import TERMS


@dataclass(frozen=True, kw_only=True, eq=False)
class CostGradient:
    """The gradient of J with respect to the forces, (..., H, 2), and with respect to the plan with the forces held
    fixed, (..., H)."""

    forces: Array
    plan: Array


def cost_terms(
    forces: Array, plan: Array, previous_action: Array | float, drag_reference: float, start: Array | None = None
) -> Array:
    """Return the unweighted terms, shape (..., 8), in the order of `TERMS`. Without `start` the term `prior` is
    zero."""
    cd, cl = forces[..., 0], forces[..., 1]
    terms = {
        "drag_mean": cd.mean(axis=-1) - drag_reference,
        "drag_fluctuation": cd.max(axis=-1) - cd.min(axis=-1),
        "lift": np.abs(cl).mean(axis=-1),
        "lift_mean": cl.mean(axis=-1) ** 2,
        "smoothness": (np.diff(plan) ** 2).mean(axis=-1),
        "effort": (plan**2).mean(axis=-1),
        "rate": (plan[..., 0] - previous_action) ** 2,
        "prior": ((plan - (plan if start is None else start)) ** 2).mean(axis=-1),
    }
    return np.stack([terms[name] for name in TERMS], axis=-1)


def cost_gradient(
    forces: Array, plan: Array, previous_action: Array | float, weights: Array, start: Array | None = None
) -> CostGradient:
    """Return the gradient of the cost J = weights . terms. `weights` is (8,) in the order of `TERMS`; `start` is the
    plan of the term `prior`, as in `cost_terms`."""
    weight = dict(zip(TERMS, weights, strict=True))
    horizon = plan.shape[-1]
    cd, cl = forces[..., 0], forces[..., 1]

    d_cd = weight["drag_mean"] * np.full_like(cd, 1.0 / horizon)
    highest, lowest = cd.max(axis=-1, keepdims=True), cd.min(axis=-1, keepdims=True)
    d_cd += weight["drag_fluctuation"] * (_share(cd == highest) - _share(cd == lowest))

    d_cl = weight["lift"] * np.sign(cl) / horizon
    d_cl += weight["lift_mean"] * 2.0 * cl.mean(axis=-1, keepdims=True) / horizon

    d_plan = weight["effort"] * 2.0 * plan / horizon
    if start is not None:
        d_plan += weight["prior"] * 2.0 * (plan - start) / horizon
    increments = np.diff(plan)
    d_plan[..., 1:] += weight["smoothness"] * 2.0 * increments / (horizon - 1)
    d_plan[..., :-1] -= weight["smoothness"] * 2.0 * increments / (horizon - 1)
    d_plan[..., 0] += weight["rate"] * 2.0 * (plan[..., 0] - previous_action)

    return CostGradient(forces=np.stack([d_cd, d_cl], axis=-1), plan=d_plan)


def _share(ties: np.typing.NDArray[np.bool_]) -> Array:
    return ties / np.count_nonzero(ties, axis=-1, keepdims=True)
