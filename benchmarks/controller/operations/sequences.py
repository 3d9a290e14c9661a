"""Consecutive control steps of recordings under control, as the ECU meets them, and the optimum of some of them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import minimize

from benchmarks.common.command_line import track
from benchmarks.controller.converged import EVALUATIONS, FALLING
from benchmarks.controller.operations.road import Memory, Problem, Road
from benchmarks.controller.situations import LEAD, encode_windows
from contract.arrays import Array
from contract.recording.dataset import Episode
from export.program.controller_program import ControllerProgram
from export.reference.mpc import adam, gradient, shift

_NEXT: Final = 1
"""Committed actions: the ECU plans for the next control period, so the present one's is under way."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sequences:
    """n stretches of consecutive windows.

    Attributes:
        z: latent states (t, n, n_z).
        previous_action, pending: a_{k-1} and a_k of the recording, (t, n).
    """

    program: ControllerProgram
    z: Array
    previous_action: Array
    pending: Array

    @classmethod
    def of(
        cls, program: ControllerProgram, episodes: Sequence[Episode], each: int, steps: int, first: int = 0
    ) -> "Sequences":
        """So many stretches of every episode, evenly spread, from its window number `first` on."""
        parts = []
        for episode in episodes:
            begin = np.linspace(first, len(episode) - program.window - steps, each).astype(int)
            parts.append(encode_windows(program, episode, begin + np.arange(steps + 1)[:, None]))
        z, action = (np.concatenate(items, axis=1) for items in zip(*parts, strict=True))
        return cls(program=program, z=z[:-1], previous_action=action[:-1], pending=action[1:])

    def problem(self, k: int, plans: Array, weights: Array) -> Problem:
        """Of time k after these plans (n, H)."""
        start, free = shift(plans), np.ones(plans.shape[-1], dtype=np.bool_)
        start[:, 0], free[:_NEXT] = self.pending[k], False
        return Problem(
            program=self.program,
            z=self.z[k],
            start=start,
            previous_action=self.previous_action[k],
            free=free,
            weights=weights,
        )

    def travelled(self, road: Road, weights: Array) -> Iterator[tuple[Problem, Array]]:
        """Every control step's problem and plans (n, H), each step from the one before; the first from zero."""
        plans, memory = np.zeros((self.z.shape[1], self.program.mpc.horizon)), Memory()
        for k in range(len(self.z)):
            problem = self.problem(k, plans, weights)
            plans, memory = road.plan(problem, memory)
            yield problem, plans


def mean_cost(sequences: Sequences, road: Road, weights: Array) -> float:
    """Of the plans after the lead, by which a road's constants are chosen."""
    found = [problem.cost(plans).mean() for problem, plans in sequences.travelled(road, weights)]
    return float(np.mean(found[LEAD:]))


def gaps(found: Array, zero: Array, optimum: Array) -> Array:
    """Costs above the optimum, as shares of what that gains over a plan of zeros."""
    return np.asarray((found - optimum) / (zero - optimum))


def optima(sequences: Sequences, times: Sequence[int], candidates: Array, weights: Array) -> Array:
    """The lowest cost found at these times, (len(times), n).

    Adam with a falling rate from a plan of zeros, from a random one and from the best candidate, of all the best by
    L-BFGS-B, whose gradient is the adjoint.

    Args:
        candidates: plans (roads, len(times), n, H) that were found there.
    """
    rng = np.random.default_rng(0)
    limit = sequences.program.action_limit
    best = []
    for place, k in enumerate(track(times, "optima", "times")):
        problem = sequences.problem(k, candidates[0, place], weights)
        costs = np.array([problem.cost(plans) for plans in candidates[:, place]])
        cheapest = candidates[costs.argmin(axis=0), place, np.arange(costs.shape[1])]
        found, ended = [costs.min(axis=0)], [cheapest]
        for start in (np.zeros_like(cheapest), rng.uniform(-limit, limit, cheapest.shape), cheapest):
            first = np.where(problem.free, start, problem.start)
            *_, plans = adam(
                sequences.program,
                problem.z,
                first,
                problem.previous_action,
                FALLING,
                free_mask=problem.free.astype(np.float64),
                weights=weights,
            )
            found.append(problem.cost(plans))
            ended.append(plans)
        chosen = np.array(ended)[np.argmin(found, axis=0), np.arange(costs.shape[1])]
        polished = [_polished(problem, i, plan) for i, plan in enumerate(chosen)]
        best.append(np.minimum(np.min(found, axis=0), polished))
    return np.array(best)


def zero_costs(sequences: Sequences, times: Sequence[int], weights: Array) -> Array:
    """Of plans of zeros but for what is committed, (len(times), n)."""
    plans = np.zeros((sequences.z.shape[1], sequences.program.mpc.horizon))
    problems = [sequences.problem(k, plans, weights) for k in times]
    return np.array([problem.cost(problem.start) for problem in problems])


def _polished(problem: Problem, i: int, start: Array) -> float:
    program, before, limit = problem.program, float(problem.previous_action[i]), problem.program.action_limit
    one = Problem(
        program=program,
        z=problem.z[i],
        start=start,
        previous_action=np.array(before),
        free=problem.free,
        weights=problem.weights,
    )

    def slope(plan: Array) -> Array:
        return gradient(program, one.z, plan, before, problem.weights)

    bounds = [(-limit, limit) if free else (a, a) for a, free in zip(start, problem.free, strict=True)]
    found = minimize(
        lambda plan: float(one.cost(plan)),
        start,
        jac=slope,
        bounds=bounds,
        method="L-BFGS-B",
        options={"maxfun": EVALUATIONS},
    )
    return float(found.fun)
