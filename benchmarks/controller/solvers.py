"""CasADi's solvers on the control step's problem, from the plan that our controller starts from: time and cost.

A gap is J - J* as a share of the gain J(zero plan) - J*, where J* is the lowest cost that any of them reached.
"""

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.common.command_line import track
from benchmarks.controller.casadi_mpc import variants
from benchmarks.controller.situations import encode_windows, receding, snapshot_steps
from contract.arrays import Array
from contract.recording.dataset import Episode
from export.program.controller_program import ControllerProgram
from export.reference.model import encode
from export.reference.mpc import optimise, plan_cost, shift

_WARM = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A control step for every solver: latent state (n_z,), previous action, and the previous plan, shifted (H,)."""

    z: Array
    previous_action: float
    start: Array


def random_problem(program: ControllerProgram, window: Array) -> Problem:
    """After a few control steps from a zero plan at the same window: for programs without a recording."""
    problem = Problem(
        z=encode(program, window), previous_action=float(window[-1, -1]), start=np.zeros(program.mpc.horizon)
    )
    for _ in range(_WARM):
        problem = replace(problem, start=shift(_ours(program, problem)))
    return problem


def recorded_problems(program: ControllerProgram, episode: Episode, count: int) -> list[Problem]:
    """Over an episode, each after control steps of our own."""
    z, previous_action = encode_windows(program, episode, snapshot_steps(program, episode, count))
    plans = receding(program, z[:-1], previous_action[:-1], np.full(count, program.mpc.learning_rate))[-1]
    return [
        Problem(z=now, previous_action=float(before), start=start)
        for now, before, start in zip(z[-1], previous_action[-1], shift(plans), strict=True)
    ]


def compare(program: ControllerProgram, problems: list[Problem]) -> dict[str, Any]:
    """Every variant on every problem, once.

    Returns:
        `start`, `ours`: mean and largest gap in per cent of the shifted plan, and of our iterations from it; `solvers`:
        the same of every variant, with its median time in ms.
    """
    solvers = variants(program)
    prices, times = [], []
    for problem in track(problems, "CasADi", "problems"):
        plans, taken = [np.zeros_like(problem.start), problem.start, _ours(program, problem)], []
        for solver in solvers:
            begin = time.perf_counter()
            plans.append(solver.solve(problem.z, problem.start, problem.previous_action))
            taken.append((time.perf_counter() - begin) * 1e3)
        prices.append(plan_cost(program, problem.z, np.array(plans), problem.previous_action))
        times.append(taken)
    costs = np.array(prices)
    best = costs.min(axis=1, keepdims=True)
    # Where doing nothing is best there is no gain to take a share of, and gaps are infinite or zero.
    gaps = 100.0 * (costs - best) / np.maximum(costs[:, :1] - best, np.finfo(float).tiny)
    _, start, ours, *theirs = ({"gap": float(np.mean(column)), "gap_worst": float(np.max(column))} for column in gaps.T)
    rows = [
        {"variant": solver.name, "ms": float(np.median(taken)), **gap}
        for solver, taken, gap in zip(solvers, np.array(times).T, theirs, strict=True)
    ]
    return {"problems": len(problems), "start": start, "ours": ours, "solvers": rows}


def _ours(program: ControllerProgram, problem: Problem) -> Array:
    """Our plan: the reference's, whatever the lowering."""
    return optimise(program, problem.z, problem.start, problem.previous_action)
