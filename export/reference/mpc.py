"""A control step in NumPy float64 (paper, section 2.4): starting plan, prediction, cost, adjoint, projected Adam.

The plan is a_t .. a_{t+H-1}. Adam runs a fixed number of iterations, and its moments start at zero, so a control step
depends on the window and the previous plan only.

`control_step` and `evaluate` take one plan (H,). The other functions take any number of plans together, (..., H). The
latent state z (..., n_z), the previous action a_{t-1} (...,) and the mask of free actions (..., H) are given for each
plan, or once for all plans. Cost weights are (8,); None stands for the program's weights. `start` is the reference plan
of the cost's term `prior`; without `start` this term is zero.

The cost J is the sum over separate, named terms of weight * term, in physical units, with hand-written gradients
(paper, equations 12-15; `cost_terms`). The terms depend on the predicted forces (Cd_k, Cl_k) at t+1 .. t+H, shape (...,
H, 2), on the plan a_0 .. a_{H-1}, shape (..., H), on the plan p from which the optimiser started, and on the previous
action a_{-1}, shape (...,) or a single number.

Where a term has a kink, its gradient is the subgradient that PyTorch uses: equal maxima or minima share the gradient
evenly, and |Cl| has slope 0 at 0.
"""

from typing import Final

import numpy as np

from contract.arrays import Array
from contract.config.controller import CostWeights
from contract.controller.goal import Goal, unknown_to_prior
from contract.controller.interface import TERMS, ControlStep
from export.program.controller_program import ControllerProgram
from export.reference.model import decode, decode_adjoint, encode, step, step_adjoint
from export.reference.prior import prior_plan

ADAM_BETAS: Final = (0.9, 0.999)
"""Decay rates of Adam's two moments. They are the values of Kingma and Ba, and PyTorch's defaults."""


def control_step(
    program: ControllerProgram,
    window: Array,
    plan: Array,
    free: Array,
    weights: Array | None = None,
    speed: float = 1.0,
    limit: float | None = None,
) -> ControlStep:
    """Compute the outputs of `controller.onnx`. The arguments are described in `contract.controller.interface`. None
    stands for the program's weights or limit; a limit above the program's limit has no effect. If the program has a
    prior, the optimiser uses only the terms that the prior does not take into account (`unknown_to_prior`). The
    returned terms and cost are for the given weights."""
    previous_action = float(window[-1, -1])
    z = encode(program, window)
    start = starting_plan(program, window, plan, free, weights, speed, limit)
    asked = _weights(program, weights)
    remaining = asked
    if program.prior is not None:
        left = unknown_to_prior(CostWeights.of(asked), knows_goal=program.prior.knows_goal)
        remaining = np.array(left.as_tuple())
    optimised = optimise(program, z, start, previous_action, free, remaining, limit)
    return evaluate(program, z, optimised, previous_action, asked, start)


def starting_plan(
    program: ControllerProgram,
    window: Array,
    plan: Array,
    free: Array,
    weights: Array | None = None,
    speed: float = 1.0,
    limit: float | None = None,
) -> Array:
    """Return the plan from which the optimiser starts, (H,): the prior's or, without one, the shifted previous plan."""
    shifted = shift(plan)
    if program.prior is None:
        return shifted
    bound, reach = _bound(program, limit), program.action_limit
    goal = Goal.of(CostWeights.of(_weights(program, weights)), bound / reach)
    return prior_plan(program.prior, window, shifted, free, reach, speed, goal, bound)


def shift(plan: Array) -> Array:
    """Return the previous plan shifted by one step; its last action is repeated."""
    return np.concatenate([plan[..., 1:], plan[..., -1:]], axis=-1)


def rollout(program: ControllerProgram, z: Array, plan: Array) -> Array:
    """Compute the latent states z_t .. z_{t+H} with the plan, shape (..., H+1, n_z)."""
    latents = [np.broadcast_to(z, (*plan.shape[:-1], z.shape[-1]))]
    for a in np.moveaxis(plan, -1, 0):
        latents.append(step(program, latents[-1], a))
    return np.stack(latents, axis=-2)


def predict(program: ControllerProgram, z: Array, plan: Array) -> Array:
    """Compute the forces (Cd, Cl) at t+1 .. t+H with the plan, shape (..., H, 2)."""
    return decode(program, rollout(program, z, plan)[..., 1:, :])


def evaluate(
    program: ControllerProgram,
    z: Array,
    plan: Array,
    previous_action: float,
    weights: Array | None = None,
    start: Array | None = None,
) -> ControlStep:
    """Compute the predicted forces, the cost terms and the cost of one plan (H,) from the latent state z (n_z,)."""
    forces = predict(program, z, plan)
    terms = cost_terms(forces, plan, previous_action, program.mpc.drag_reference, start)
    return ControlStep(plan=plan, forces=forces, terms=terms, cost=float(terms @ _weights(program, weights)))


def gradient(
    program: ControllerProgram,
    z: Array,
    plan: Array,
    previous_action: Array | float,
    weights: Array | None = None,
    start: Array | None = None,
) -> Array:
    """Compute the gradient dJ/da_k, shape (..., H), by the discrete adjoint. Let lambda_k = dJ/dz_{t+k}; lambda_H comes
    from the forces at t+H alone. Backwards in k, (lambda_k, dJ/da_k) = step_adjoint(lambda_{k+1}), and the contribution
    of the forces at t+k is added to each lambda_k."""
    latents = rollout(program, z, plan)
    forces = decode(program, latents[..., 1:, :])
    to_forces, total = cost_gradient(forces, plan, previous_action, _weights(program, weights), start)
    through_forces = decode_adjoint(program, latents[..., 1:, :], to_forces)
    d_latent = np.zeros_like(latents[..., 0, :])
    for k in reversed(range(plan.shape[-1])):
        d_latent = d_latent + through_forces[..., k, :]
        d_latent, d_action = step_adjoint(program, latents[..., k, :], plan[..., k], d_latent)
        total[..., k] += d_action
    return total


def optimise(
    program: ControllerProgram,
    z: Array,
    plan: Array,
    previous_action: Array | float,
    free_mask: Array | float = 1.0,
    weights: Array | None = None,
    limit: float | None = None,
) -> Array:
    """Run projected Adam on the free actions, with the program's iterations and learning rate, from a plan (..., H).

    With gradient g, moments m and v, and constants b1 and b2, for i = 1, 2, ..:
    m <- b1 m + (1 - b1) g, v <- b2 v + (1 - b2) g^2,
    a <- clip(a - lr (m / (1 - b1^i)) / (sqrt(v / (1 - b2^i)) + eps)).

    `free_mask` is 1 where an action may be changed, 0 where it is committed. `limit` is a bound on |a|; if it is None
    or larger than the program's bound, the program's bound applies.
    """
    beta1, beta2 = ADAM_BETAS
    mpc, is_free, bound = program.mpc, np.asarray(free_mask) > 0.5, _bound(program, limit)
    start = plan
    m = np.zeros_like(plan)
    v = np.zeros_like(plan)
    for i in range(1, mpc.iterations + 1):
        g = gradient(program, z, plan, previous_action, weights, start)
        m = beta1 * m + (1.0 - beta1) * g
        v = beta2 * v + (1.0 - beta2) * g**2
        direction = (m / (1.0 - beta1**i)) / (np.sqrt(v / (1.0 - beta2**i)) + mpc.epsilon)
        plan = np.where(is_free, np.clip(plan - mpc.learning_rate * direction, -bound, bound), plan)
    return plan


def _bound(program: ControllerProgram, limit: float | None) -> float:
    return program.action_limit if limit is None else min(limit, program.action_limit)


def _weights(program: ControllerProgram, weights: Array | None) -> Array:
    return np.array(program.mpc.weights.as_tuple()) if weights is None else weights


def cost_terms(
    forces: Array, plan: Array, previous_action: Array | float, drag_reference: float, start: Array | None = None
) -> Array:
    """Return the unweighted terms, shape (..., 8), in the order of `TERMS`. Without `start`, `prior` is zero."""
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
) -> tuple[Array, Array]:
    """Return the gradient of the cost J = weights . terms with respect to the forces, (..., H, 2), and with respect to
    the plan with the forces held fixed, (..., H). `weights` is (8,) in the order of `TERMS`; `start` is the
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
    return np.stack([d_cd, d_cl], axis=-1), d_plan


def _share(ties: np.typing.NDArray[np.bool_]) -> Array:
    return ties / np.count_nonzero(ties, axis=-1, keepdims=True)
