"""Cost, gradient and projected Adam of many plans at once: `export.reference.mpc` with one more axis.

The networks and their adjoints are the reference's, which act on the last axis of any array; only the loops over the
horizon stand here again. n plans have shape (n, H), their latent states (n, n_z) and their actions in force (n,).
"""

from collections.abc import Collection

import numpy as np

from export.program.controller_program import ControllerProgram
from export.program.weights import Array
from export.reference.cost import cost_gradient, cost_terms
from export.reference.model import decode, decode_vjp, step, step_vjp
from export.reference.mpc import ADAM_BETAS, ADAM_EPSILON, project


def costs(program: ControllerProgram, z: Array, plans: Array, previous: Array) -> Array:
    """J of every plan, shape (n,)."""
    return _priced(program, decode(program, _rollout(program, z, plans)[1:]), plans, previous)


def costs_and_gradients(program: ControllerProgram, z: Array, plans: Array, previous: Array) -> tuple[Array, Array]:
    """J (n,) and dJ/da (n, H) of every plan, by the discrete adjoint."""
    weights = np.array(program.mpc.weights.as_tuple())
    latents = _rollout(program, z, plans)
    forces = decode(program, latents[1:])
    local = [
        cost_gradient(forces[:, i], plan, float(before), weights)
        for i, (plan, before) in enumerate(zip(plans, previous, strict=True))
    ]
    through_forces = decode_vjp(program, latents[1:], np.stack([part.forces for part in local], axis=1))
    total = np.array([part.plan for part in local])
    adjoint = np.zeros_like(z)
    for k in reversed(range(plans.shape[1])):
        adjoint, d_action = step_vjp(program, latents[k], plans[:, k], adjoint + through_forces[k])
        total[:, k] += d_action
    return _priced(program, forces, plans, previous), total


def adam(
    program: ControllerProgram,
    z: Array,
    plans: Array,
    previous: Array,
    rates: Array,
    keep: Collection[int] = (),
) -> dict[int, Array]:
    """Projected Adam from zero moments.

    Args:
        rates: learning rate of each iteration, (iterations,), or of each plan in it, (iterations, n).
        keep: iterations after which the plans are kept; the last one is always.

    Returns:
        Plans by number of iterations.
    """
    beta1, beta2 = ADAM_BETAS
    m, v = np.zeros_like(plans), np.zeros_like(plans)
    kept = {}
    for i, rate in enumerate(rates, start=1):
        _, g = costs_and_gradients(program, z, plans, previous)
        m = beta1 * m + (1.0 - beta1) * g
        v = beta2 * v + (1.0 - beta2) * g**2
        direction = (m / (1.0 - beta1**i)) / (np.sqrt(v / (1.0 - beta2**i)) + ADAM_EPSILON)
        plans = project(plans - np.asarray(rate)[..., None] * direction, program.action_limit)
        if i in keep or i == len(rates):
            kept[i] = plans
    return kept


def _rollout(program: ControllerProgram, z: Array, plans: Array) -> Array:
    """z_t .. z_{t+H}, shape (H+1, n, n_z)."""
    latents = [z]
    for a in plans.T:
        latents.append(step(program, latents[-1], a))
    return np.array(latents)


def _priced(program: ControllerProgram, forces: Array, plans: Array, previous: Array) -> Array:
    """J (n,) of forces (H, n, 2)."""
    terms = [
        cost_terms(forces[:, i], plan, float(before), program.mpc.drag_reference)
        for i, (plan, before) in enumerate(zip(plans, previous, strict=True))
    ]
    return np.asarray(np.array(terms) @ np.array(program.mpc.weights.as_tuple()))
