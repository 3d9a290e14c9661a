"""The same MPC problem in CasADi, for its own solvers: what a control engineer would write instead.

The network (dynamics and decoder), the horizon, the bounds and the cost are the reference's, in float64. The cost has
two kinks, max Cd - min Cd and |Cl|, and there are two ways to write it:

- `single_shooting`: the plan is the only unknown; the kinks stay, as `mmax`, `mmin` and `fabs` with CasADi's one-sided
  derivatives.
- `multiple_shooting`: the latent states are unknowns too, tied by the dynamics. Slack variables take the kinks' place:
  top >= Cd_k >= bottom and s_k >= |Cl_k|. At the optimum both costs agree, and all functions are smooth but ELU's
  second derivative at 0.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import casadi as ca
import numpy as np

from contract.arrays import Array
from contract.controller.interface import TERMS
from export.program.controller_program import ControllerProgram
from export.program.weights import LAYER_NORM_EPSILON, Linear, Norm
from export.reference.model import decode
from export.reference.mpc import rollout

IPOPT: Final = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False, "ipopt.warm_start_init_point": "yes"}
_MANY: Final = 100
_FEW: Final = 5
"""Iterations of the variants that stop early, as many as our controller makes."""


SQP: Final = {
    "qpsol": "qrqp",
    "qpsol_options": {"print_iter": False, "print_header": False, "error_on_fail": False},
    "hessian_approximation": "limited-memory",
    "max_iter": _FEW,
    "print_header": False,
    "print_iteration": False,
    "print_status": False,
    "print_time": False,
    "error_on_fail": False,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class CasadiVariant:
    """A solver and what it needs.

    Attributes:
        name: for the table.
        solve: (z (n_z,), plan to start from (H,), previous action) -> plan (H,).
    """

    name: str
    solve: Callable[[Array, Array, float], Array]


def variants(program: ControllerProgram) -> tuple[CasadiVariant, ...]:
    """IPOPT on both forms, to tolerance and stopped early, and SQP."""
    few = {"ipopt.max_iter": _FEW}
    approximate = {"ipopt.hessian_approximation": "limited-memory"}
    return (
        _single(program, "single shooting, IPOPT", "ipopt", IPOPT | approximate | {"ipopt.max_iter": _MANY}),
        _single(program, "single shooting, IPOPT, 5 iterations", "ipopt", IPOPT | approximate | few),
        _single(program, "single shooting, SQP, 5 iterations", "sqpmethod", SQP),
        _multiple(program, "multiple shooting, IPOPT", IPOPT | {"ipopt.max_iter": _MANY}),
        _multiple(program, "multiple shooting, IPOPT, 5 iterations", IPOPT | few),
    )


def cost_function(program: ControllerProgram) -> Any:
    """J(z, plan, previous action) with its kinks, as a CasADi function."""
    z, plan, previous_action = _symbols(program)
    return ca.Function(
        "J", [z, plan, previous_action], [_kinked(program, _forces(program, z, plan), plan, previous_action)]
    )


def _single(program: ControllerProgram, name: str, solver: str, options: dict[str, Any]) -> CasadiVariant:
    z, plan, previous_action = _symbols(program)
    cost = _kinked(program, _forces(program, z, plan), plan, previous_action)
    nlp = ca.nlpsol("nlp", solver, {"x": plan, "p": ca.vertcat(z, previous_action), "f": cost}, options)
    limit = program.action_limit

    def solve(state: Array, start: Array, before: float) -> Array:
        found = nlp(x0=start, p=np.append(state, before), lbx=-limit, ubx=limit)
        return np.asarray(np.clip(np.array(found["x"]).ravel(), -limit, limit))

    return CasadiVariant(name=name, solve=solve)


def _multiple(program: ControllerProgram, name: str, options: dict[str, Any]) -> CasadiVariant:
    horizon, limit = program.mpc.horizon, program.action_limit
    z, plan, previous_action = _symbols(program)
    later = ca.MX.sym("later", program.latent, horizon)
    slack = ca.MX.sym("slack", horizon)
    top, bottom = ca.MX.sym("top"), ca.MX.sym("bottom")

    z_k, a_k = ca.MX.sym("z_k", program.latent), ca.MX.sym("a_k")
    one = ca.Function("one", [z_k, a_k], [_step(program, z_k, a_k)]).map(horizon)
    forces = ca.Function("forces", [z_k], [_decode(program, z_k)]).map(horizon)(later)
    cd, cl = forces[0, :].T, forces[1, :].T
    gaps = later - one(ca.horzcat(z, later[:, :-1]), plan.T)
    cost = _cost(program, ca.sum1(cd) / horizon, top - bottom, ca.sum1(slack) / horizon, cl, plan, previous_action)
    constraints = ca.vertcat(ca.vec(gaps), top - cd, cd - bottom, slack - cl, slack + cl)
    unknowns = ca.vertcat(plan, ca.vec(later), slack, top, bottom)
    nlp = ca.nlpsol(
        "nlp", "ipopt", {"x": unknowns, "p": ca.vertcat(z, previous_action), "f": cost, "g": constraints}, options
    )
    states = program.latent * horizon
    lower = np.concatenate([np.full(horizon, -limit), np.full(states, -np.inf), np.zeros(horizon), [-np.inf, -np.inf]])
    upper = np.concatenate([np.full(horizon, limit), np.full(states + horizon + 2, np.inf)])
    most = np.concatenate([np.zeros(states), np.full(4 * horizon, np.inf)])

    def solve(state: Array, start: Array, before: float) -> Array:
        # The states and slacks of the plan to start from: the warm start is feasible.
        latents = rollout(program, state, start)[1:]
        drag, lift = decode(program, latents).T
        begin = np.concatenate([start, latents.ravel(), np.abs(lift), [drag.max(), drag.min()]])
        found = nlp(x0=begin, p=np.append(state, before), lbx=lower, ubx=upper, lbg=0.0, ubg=most)
        return np.asarray(np.clip(np.array(found["x"]).ravel()[:horizon], -limit, limit))

    return CasadiVariant(name=name, solve=solve)


def _symbols(program: ControllerProgram) -> tuple[Any, Any, Any]:
    return ca.MX.sym("z", program.latent), ca.MX.sym("plan", program.mpc.horizon), ca.MX.sym("previous_action")


def _forces(program: ControllerProgram, z: Any, plan: Any) -> Any:
    """(2, H) under the plan, by a roll-out whose steps are calls of one function."""
    z_k, a_k = ca.MX.sym("z_k", program.latent), ca.MX.sym("a_k")
    one = ca.Function("one", [z_k, a_k], [_step(program, z_k, a_k)])
    latents = one.mapaccum(program.mpc.horizon)(z, plan.T)
    return ca.Function("forces", [z_k], [_decode(program, z_k)]).map(program.mpc.horizon)(latents)


def _kinked(program: ControllerProgram, forces: Any, plan: Any, previous_action: Any) -> Any:
    cd, cl = forces[0, :].T, forces[1, :].T
    horizon = program.mpc.horizon
    spread = ca.mmax(cd) - ca.mmin(cd)
    return _cost(program, ca.sum1(cd) / horizon, spread, ca.sum1(ca.fabs(cl)) / horizon, cl, plan, previous_action)


def _cost(
    program: ControllerProgram, drag: Any, spread: Any, lift: Any, cl: Any, plan: Any, previous_action: Any
) -> Any:
    horizon = program.mpc.horizon
    terms = {
        "drag_mean": drag - program.mpc.drag_reference,
        "drag_fluctuation": spread,
        "lift": lift,
        "lift_mean": (ca.sum1(cl) / horizon) ** 2,
        "smoothness": ca.sumsqr(ca.diff(plan)) / (horizon - 1),
        "effort": ca.sumsqr(plan) / horizon,
        "rate": (plan[0] - previous_action) ** 2,
    }
    return sum(weight * terms[name] for name, weight in zip(TERMS, program.mpc.weights.as_tuple(), strict=True))


def _step(program: ControllerProgram, z: Any, a: Any) -> Any:
    weights = program.dynamics
    first = _elu(_norm(weights.norm_in, _linear(weights.input, ca.vertcat(z, a / program.scaling.action_std))))
    second = _elu(_norm(weights.norm_hidden, _linear(weights.hidden, first)))
    return z + _linear(weights.output, second)


def _decode(program: ControllerProgram, z: Any) -> Any:
    weights = program.decoder
    x = _linear(weights.input, z)
    for block in weights.blocks:
        x = x + _elu(_norm(block.norm, _linear(block.linear, x)))
    return _linear(weights.output, x) * np.array(program.scaling.force_std) + np.array(program.scaling.force_mean)


def _linear(layer: Linear, x: Any) -> Any:
    return ca.mtimes(ca.DM(layer.weight), x) + layer.bias


def _norm(norm: Norm, x: Any) -> Any:
    centred = x - ca.sum1(x) / x.shape[0]
    deviation = ca.sqrt(ca.sumsqr(centred) / x.shape[0] + LAYER_NORM_EPSILON)
    return centred / deviation * norm.weight + norm.bias


def _elu(x: Any) -> Any:
    return ca.fmax(x, 0.0) + ca.expm1(ca.fmin(x, 0.0))
