"""One control step in NumPy float64 (paper, section 2.4): shift, predict, adjoint, projected Adam.

The plan is a_t .. a_{t+H-1}, shape (H,). Adam runs a fixed number of iterations from zero moments, so a
control step depends on the window and the previous plan only, and always takes the same time.
"""

from typing import Final

import numpy as np

from contract.controller.interface import ControlStep
from export.program.controller_program import ControllerProgram
from export.program.weights import Array
from export.reference.cost import cost_gradient, cost_terms
from export.reference.model import decode, decode_vjp, encode, step, step_vjp

ADAM_BETAS: Final = (0.9, 0.999)
ADAM_EPSILON: Final = 1e-8
"""Kingma and Ba's constants, which are also PyTorch's defaults."""


def control_step(
    program: ControllerProgram, window: Array, plan: Array, free: Array, weights: Array | None = None
) -> ControlStep:
    """What `controller.onnx` computes; arguments as in `contract.controller.interface`.

    Args:
        window: (L, S+1) rows (Cp_k, a_{k-1}), oldest first.
        plan: (H,) the previous step's plan as it came out.
        free: (H,) 1 where the shifted plan may be changed, 0 where it is committed.
        weights: (7,) cost weights; the program's if None.
    """
    weights = np.array(program.mpc.weights.as_tuple()) if weights is None else weights
    previous_action = float(window[-1, -1])
    z = encode(program, window)
    return evaluate(
        program, z, optimise(program, z, shift(plan), previous_action, free, weights), previous_action, weights
    )


def shift(plan: Array) -> Array:
    """Warm start: the previous plan one step later, its last action repeated."""
    return np.append(plan[1:], plan[-1])


def rollout(program: ControllerProgram, z: Array, plan: Array) -> Array:
    """z_t .. z_{t+H} under the plan, shape (H+1, n_z)."""
    latents = [z]
    for a in plan:
        latents.append(step(program, latents[-1], a))
    return np.array(latents)


def evaluate(program: ControllerProgram, z: Array, plan: Array, previous_action: float, weights: Array) -> ControlStep:
    """Predicted forces and cost of a plan from latent state z."""
    forces = decode(program, rollout(program, z, plan)[1:])
    terms = cost_terms(forces, plan, previous_action, program.mpc.drag_reference)
    return ControlStep(plan=plan, forces=forces, terms=terms, cost=float(weights @ terms))


def gradient(program: ControllerProgram, z: Array, plan: Array, previous_action: float, weights: Array) -> Array:
    """dJ/da_k, shape (H,), by the discrete adjoint.

    With lambda_k = dJ/dz_{t+k} and lambda_H = dJ/dz_{t+H} through the forces alone, backwards in k:
    (lambda_k, dJ/da_k) = step_vjp(lambda_{k+1}), each lambda_k taking its own forces' share on top.
    """
    latents = rollout(program, z, plan)
    local = cost_gradient(decode(program, latents[1:]), plan, previous_action, weights)
    through_forces = decode_vjp(program, latents[1:], local.forces)

    total = local.plan.copy()
    adjoint = np.zeros_like(z)
    for k in reversed(range(len(plan))):
        adjoint, d_action = step_vjp(program, latents[k], plan[k], adjoint + through_forces[k])
        total[k] += d_action
    return total


def optimise(
    program: ControllerProgram, z: Array, plan: Array, previous_action: float, free: Array, weights: Array
) -> Array:
    """Fixed-iteration projected Adam on the free actions, from `plan`; committed ones come back unchanged.

    For i = 1, 2, ..: m <- b1 m + (1 - b1) g, v <- b2 v + (1 - b2) g^2,
    a <- project(a - lr (m / (1 - b1^i)) / (sqrt(v / (1 - b2^i)) + eps)).
    """
    beta1, beta2 = ADAM_BETAS
    is_free = free > 0.5
    m = np.zeros_like(plan)
    v = np.zeros_like(plan)
    for i in range(1, program.mpc.iterations + 1):
        g = gradient(program, z, plan, previous_action, weights)
        m = beta1 * m + (1.0 - beta1) * g
        v = beta2 * v + (1.0 - beta2) * g**2
        direction = (m / (1.0 - beta1**i)) / (np.sqrt(v / (1.0 - beta2**i)) + ADAM_EPSILON)
        moved = project(plan - program.mpc.learning_rate * direction, program.action_limit)
        plan = np.where(is_free, moved, plan)
    return plan


def project(plan: Array, limit: float) -> Array:
    """The nearest plan with every |a| <= limit."""
    return np.clip(plan, -limit, limit)
