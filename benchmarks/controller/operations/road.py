"""Ways from the shifted plan to a better one, many plans at once.

A road takes some iterations of gradient -> rule -> projected move. A rule makes of a gradient the move, (n, H), and
keeps what it remembers. All act on the free actions alone; what is committed stays.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from contract.arrays import Array
from contract.controller.interface import TERMS
from export.program.controller_program import ControllerProgram
from export.program.matrices import matrices
from export.reference.model import decode_adjoint, step_adjoint
from export.reference.mpc import ADAM_BETAS, ADAM_EPSILON, gradient, plan_cost, predict, project, rollout, shift


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """Control steps of n controllers at one time.

    Attributes:
        z: latent states (n, n_z).
        start: last plans, shifted, with what is committed in its place, (n, H).
        previous_action: a_{t-1}, (n,).
        free: which actions may be changed, (H,).
        weights: of the cost, (7,).
    """

    program: ControllerProgram
    z: Array
    start: Array
    previous_action: Array
    free: NDArray[np.bool_]
    weights: Array

    def cost(self, plan: Array) -> Array:
        return plan_cost(self.program, self.z, plan, self.previous_action, self.weights)


Memory = tuple[Array, ...]
Rule = Callable[[Problem, Array, Array, Memory], tuple[Array, Memory]]
"""(problem, plan, gradient, memory) -> (direction for a rate of 1, memory); () is no memory."""


def adam(problem: Problem, plan: Array, slope: Array, memory: Memory) -> tuple[Array, Memory]:
    """As the control step's; memory is (m, v, iterations)."""
    m, v, count = memory or (np.zeros_like(slope), np.zeros_like(slope), np.zeros(()))
    (beta1, beta2), count = ADAM_BETAS, count + 1.0
    m, v = beta1 * m + (1.0 - beta1) * slope, beta2 * v + (1.0 - beta2) * slope**2
    scaled = np.sqrt(v / (1.0 - beta2**count)) + ADAM_EPSILON
    return -(m / (1.0 - beta1**count)) / scaled, (m, v, count)


def heavy_ball(problem: Problem, plan: Array, slope: Array, memory: Memory) -> tuple[Array, Memory]:
    """Polyak's momentum of 0.9; memory is the velocity."""
    velocity = 0.9 * memory[0] - slope if memory else -slope
    return velocity, (velocity,)


@dataclass(frozen=True)
class Blocked:
    """Adam on the sums of so many blocks, evenly long: move blocking of what is added to the shifted plan."""

    blocks: int

    def __call__(self, problem: Problem, plan: Array, slope: Array, memory: Memory) -> tuple[Array, Memory]:
        block = np.zeros(slope.shape[-1], dtype=np.intp)
        for number, places in enumerate(np.array_split(np.flatnonzero(problem.free), self.blocks)):
            block[places] = number
        sums = np.stack([slope[:, problem.free & (block == i)].sum(axis=1) for i in range(self.blocks)], axis=1)
        direction, memory = adam(problem, plan, sums, memory)
        return direction[:, block], memory


@dataclass(frozen=True, eq=False)
class Newton:
    """-(B + damping 1)^-1 g, where B is the curvature that is known without differentiating the networks twice.

    Attributes:
        damping: what the networks' own curvature and the kinks of the cost make necessary.
        lift: what B has of the lift terms by Gauss and Newton, beside the tridiagonal smoothness, effort and rate:
            "none"; "exact", which takes every step's Jacobian; or what `lift_curvature` finds on average, (2, H, H),
            which takes nothing.
    """

    damping: float
    lift: Literal["none", "exact"] | Array

    def __call__(self, problem: Problem, plan: Array, slope: Array, memory: Memory) -> tuple[Array, Memory]:
        weight = dict(zip(TERMS, problem.weights, strict=True))
        horizon = plan.shape[-1]
        increments = np.diff(np.eye(horizon), axis=0)
        curvature = 2.0 * weight["smoothness"] / (horizon - 1) * increments.T @ increments
        curvature = curvature + (self.damping + 2.0 * weight["effort"] / horizon) * np.eye(horizon)
        curvature[0, 0] += 2.0 * weight["rate"]
        every = np.broadcast_to(curvature, (len(plan), horizon, horizon))
        if not isinstance(self.lift, str) or self.lift == "exact":
            of_lift, of_mean = lift_curvature(problem, plan) if isinstance(self.lift, str) else self.lift
            every = every + weight["lift"] * of_lift + weight["lift_mean"] * of_mean
        free = np.flatnonzero(problem.free)
        move = np.zeros_like(plan)
        move[:, free] = -np.linalg.solve(every[:, free[:, None], free], slope[:, free, None])[..., 0]
        return move, ()


def lift_curvature(problem: Problem, plan: Array) -> Array:
    """d2/da2 by Gauss and Newton of mean |Cl|, as of Cl^2 / (2 max(|Cl|, 0.05)), and of (mean Cl)^2: (2, n, H, H)."""
    slopes = lift_slopes(problem, plan)
    lift = predict(problem.program, problem.z, plan)[..., 1]
    softened = slopes / np.maximum(np.abs(lift), 0.05)[..., None] / plan.shape[-1]
    mean = slopes.mean(axis=1)
    return np.stack([np.swapaxes(slopes, 1, 2) @ softened, 2.0 * mean[:, :, None] * mean[:, None, :]])


def lift_slopes(problem: Problem, plan: Array) -> Array:
    """dCl_j / da_k, (n, H, H), by the 8x8 Jacobians of every step."""
    program, horizon = problem.program, plan.shape[-1]
    latents = rollout(program, problem.z, plan)
    unit = np.eye(program.latent)
    of_state, of_action = step_adjoint(program, latents[:, :-1, None, :], plan[..., None], unit)
    of_lift = decode_adjoint(program, latents[:, 1:, :], np.array([0.0, 1.0]))
    tangents = np.zeros((len(plan), program.latent, horizon))
    slopes = np.zeros((len(plan), horizon, horizon))
    for k in range(horizon):
        tangents = of_state[:, k] @ tangents
        tangents[:, :, k] = of_action[:, k]
        slopes[:, k] = (of_lift[:, k, None, :] @ tangents)[:, 0]
    return slopes


class Proposal(Protocol):
    """A learned warm start."""

    @property
    def multiply_accumulates(self) -> int:
        """Of one proposal."""
        ...

    def __call__(self, problem: Problem) -> Array:
        """Plans (n, H)."""
        ...


@dataclass(frozen=True, kw_only=True)
class Road:
    """A way to plan.

    Attributes:
        name, kind: for people; what ladders and tables group by.
        rate: factor of the rule's direction.
        carried: whether the rule's memory goes on into the next control step, shifted as the plan is.
        proposal: a start beside the shifted plan; the cheaper one is taken, by one roll-out more.
    """

    name: str
    rule: Rule
    rate: float
    iterations: int
    carried: bool = False
    proposal: Proposal | None = field(default=None)

    def plan(self, problem: Problem, memory: Memory = ()) -> tuple[Array, Memory]:
        """The plans (n, H) of one control step, and what to give to the next."""
        limit, plan = problem.program.action_limit, problem.start
        if self.proposal is not None:
            proposed = np.where(problem.free, project(self.proposal(problem), limit), plan)
            plan = np.where((problem.cost(proposed) < problem.cost(plan))[:, None], proposed, plan)
        memory = tuple(shift(item) if item.ndim else item for item in memory) if self.carried else ()
        for _ in range(self.iterations):
            slope = gradient(problem.program, problem.z, plan, problem.previous_action, problem.weights)
            direction, memory = self.rule(problem, plan, slope, memory)
            plan = np.where(problem.free, project(plan + self.rate * direction, limit), plan)
        return plan, memory

    def passes(self) -> tuple[int, int]:
        """Roll-outs of a control step with their forces, and adjoints; the last roll-out evaluates the plan."""
        return self.iterations + 1 + (self.proposal is not None), self.iterations

    def multiply_accumulates(self, program: ControllerProgram) -> int:
        """Of a control step: products of weights, and what a proposal and a Gauss-Newton step need beside them."""
        size = {name: weight.size for name, weight in matrices(program).items()}
        recurrent = sum(n for name, n in size.items() if name.startswith("lstm"))
        head = sum(n for name, n in size.items() if name.startswith("encoder"))
        dynamics = sum(n for name, n in size.items() if name.startswith("dynamics"))
        decoder = sum(n for name, n in size.items() if name.startswith("decoder"))
        horizon, latent = program.mpc.horizon, program.latent
        total = program.window * recurrent + head + sum(self.passes()) * horizon * (dynamics + decoder)
        if self.proposal is not None:
            total += self.proposal.multiply_accumulates
        if not isinstance(self.rule, Newton):
            return total
        if not isinstance(self.rule.lift, str):
            # The matrix is factored once a control step, since weights may change; then a solution an iteration.
            total += horizon**3 // 6 + self.iterations * horizon**2
        elif self.rule.lift == "exact":
            jacobians = horizon * (latent * dynamics + decoder)
            tangents = horizon * (horizon - 1) // 2 * latent * (latent + 1)
            normal_matrix = horizon * horizon * (horizon + 1) // 2
            total += self.iterations * (jacobians + tangents + normal_matrix + horizon**3 // 6)
        return total
