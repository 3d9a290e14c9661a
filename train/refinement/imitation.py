"""The imitation: one prior, the learner, is fitted to the actions of other priors, the teachers.

A training over all speeds improves a prior at some speeds and makes it worse at others. So each teacher runs in closed
loop at speeds at which it is good. The learner's scheduled weights for speeds below or above the design speed are then
fitted to the teachers' actions. These weights are multiplied by the distance from the design speed, so the learner does
not change at the design speed.

A vehicle knows its speed over the ground, but not the wind, so the speed that a prior reads may be wrong. A learner can
correct the error, because the pressures depend on the true speed. It learns with right and wrong speeds; its teachers
receive the true speed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Final

import numpy as np
import torch
from torch import Tensor

from contract.arrays import Array
from contract.controller.goal import SPEED_PLACES, Goal, schedule
from contract.differentiable import DifferentiableFlow, FlowState
from train.refinement.feedback import Feedback
from train.refinement.windows import Stream, StretchReadings, closed_loop, read

PERIODS_AT_ONCE: Final = 100
"""Number of periods that the tape stores at once."""
SLOWEST: Final = 0.5
"""Lowest speed, in units of the design speed, for which each run stores enough rows; a slower run stores more."""
OPTIMISER_STEPS: Final = 400
"""Steps of the optimiser (L-BFGS)."""
SMALL: Final = 1e-3
"""Factor in the cost for the mean squared change of the weights; the mean squared error of action / limit has the
factor 1. This term determines the weights on which the error hardly depends."""
RIGHT: Final = 10.0
"""Weight of a demonstration with the right speed, relative to a demonstration with a wrong speed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Watched:
    """A closed loop of n control periods. Rows (n, 2 p + 1) have differences and sums of the sensor pairs in Cp, made
    dimensionless with the true speed, and the action that starts in the period. Actions and the true `speeds` (n,) are
    in units of the design speed. `Cd` (n,) are drag coefficients at the ends of the periods."""

    rows: Tensor
    speeds: Array
    Cd: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Demonstration:
    """A prior's inputs in n control periods, and the actions (n,) that it should learn. Rows (n, M, 2 p + 1) and
    actions are in units of the told speed; the told `speeds` (n,) are in units of the design speed. `weight` is the
    weight of a period in the fit."""

    rows: Tensor
    speeds: Array
    actions: Tensor
    weight: float = 1.0


def watch(
    flow: DifferentiableFlow, feedback: Feedback, start: FlowState, speeds: Array, goal: Goal, *, told: Array
) -> Watched:
    """Run a feedback in closed loop from a wake without jets at the design speed. `speeds` (n + 1,) are the true speeds
    at the samples of n periods, in units of the design speed; the first is 1. `told` (n,) is the speed that the
    feedback is told, divided by the true speed. Raises PlantError if the flow diverged."""
    stream = Stream.begun(start, feedback, min(SLOWEST, float((speeds[:-1] * told).min())))
    stream.goal = goal
    rows, Cd = list[Array](), list[float]()
    with torch.no_grad():
        for first in range(0, len(told), PERIODS_AT_ONCE):
            part = told[first : first + PERIODS_AT_ONCE]
            readings = replace(StretchReadings.plain(len(part), feedback.pairs), told=part)
            run = closed_loop(flow, feedback, stream, readings, speeds[first : first + len(part) + 1])
            rows += [row.numpy() for row in run.leaves]
            Cd += [one.Cd for one in run.seen[1:]]
    true = np.array(rows)
    true[:, :-1] *= told[:, None] ** 2
    return Watched(rows=torch.from_numpy(true), speeds=speeds[:-1], Cd=np.array(Cd))


def demonstration(
    run: Watched, expert: Feedback, goal: Goal, *, told: Array, expert_told: float = 1.0
) -> Demonstration:
    """Return an expert's actions in the states of a run, as a demonstration for a prior that may be told another speed.
    `told` (n,) and `expert_told` are the speeds that prior and expert are told, divided by the true speed. The first
    periods are left out, because they have too few earlier rows."""
    limit = goal.share_of_limit() * expert.limit
    prior_reads, expert_reads = (rows_as_told(run, ratio, expert.memory) for ratio in (told, np.array([expert_told])))
    both = min(len(prior_reads), len(expert_reads))
    prior_reads, expert_reads, left_out = prior_reads[-both:], expert_reads[-both:], len(run.rows) - both
    actions = list[float]()
    for k, ((_, said), (rows, speed)) in enumerate(zip(prior_reads, expert_reads, strict=True)):
        before = float(run.rows[left_out + k, -1])
        with torch.no_grad():
            action = float(expert(rows, speed, goal))
        command = before + min(1.0, speed * speed) * (action * speed - before)
        command = min(max(command, -limit), limit)
        actions.append((before + (command - before) / min(1.0, said * said)) / said)
    return Demonstration(
        rows=torch.stack([rows for rows, _ in prior_reads]),
        speeds=np.array([said for _, said in prior_reads]),
        actions=torch.tensor(actions, dtype=torch.float64),
        weight=RIGHT if (told == 1.0).all() else 1.0,
    )


def rows_as_told(run: Watched, told: Array, memory: int) -> list[tuple[Tensor, float]]:
    """Return the rows (M, 2 p + 1) that a prior reads, and the told speed, for each period with enough earlier rows."""
    kept = ceil(memory / min(SLOWEST, float((run.speeds * told).min()))) + 1
    scale = torch.from_numpy(1.0 / told**2)[:, None]
    rows, speeds = torch.cat([run.rows[:, :-1] * scale, run.rows[:, -1:]], dim=1), (run.speeds * told).tolist()
    spans = [slice(last - kept, last) for last in range(kept, len(rows) + 1)]
    return [(read(rows[span], speeds[span], memory), speeds[span.stop - 1]) for span in spans]


def imitate(feedback: Feedback, given: Sequence[Demonstration], goal: Goal, *, faster: bool) -> tuple[float, float]:
    """Fit the feedback's scheduled weights for speeds above (`faster`) or below the design speed, in place, to
    demonstrations of a goal. Only periods whose told speed is on the fitted side are used. Returns the weighted rms
    error of the action, and the rms of the action, both divided by the release's action limit."""
    place = SPEED_PLACES[faster]
    speeds = np.concatenate([one.speeds for one in given])
    side = (speeds > 1.0) == faster
    scheduled = torch.tensor([schedule(float(speed), goal) for speed in speeds[side]], dtype=torch.float64)
    odd, even = feedback.features(torch.cat([one.rows for one in given])[side])
    wanted, limit = torch.cat([one.actions for one in given])[side], goal.share_of_limit() * feedback.limit
    weights = torch.from_numpy(np.repeat([one.weight for one in given], [len(one.speeds) for one in given])[side])
    weights = weights / weights.mean()
    first, gate = (one.detach()[place].clone() for one in (feedback.first, feedback.gate))
    share = scheduled[:, place, None]
    with torch.no_grad():
        inner = torch.einsum("ns,ni,siu->nu", scheduled, odd, feedback.first) - share * (odd @ first)
        gates = torch.cat([scheduled, even], dim=1) @ feedback.gate - share * gate
    new_first, new_gate = first.clone().requires_grad_(), gate.clone().requires_grad_()
    output = feedback.output.detach()
    optimiser = torch.optim.LBFGS(
        [new_first, new_gate], max_iter=OPTIMISER_STEPS, history_size=20, line_search_fn="strong_wolfe"
    )

    def error() -> Tensor:
        units = torch.tanh(inner + share * (odd @ new_first))
        opened = 1.0 + torch.tanh(gates + share * new_gate)
        done: Tensor = limit * torch.tanh((opened * units) @ output) - wanted
        return (weights * (done / feedback.limit).square()).mean()

    def step() -> Tensor:
        optimiser.zero_grad()
        change = (new_first - first).square().mean() + 0.1 * (new_gate - gate).square().mean()
        cost = error() + SMALL * change
        torch.autograd.backward(cost)
        return cost

    optimiser.step(step)  # type: ignore[no-untyped-call]
    with torch.no_grad():
        feedback.first[place], feedback.gate[place] = new_first, new_gate
        return float(error().sqrt()), float((wanted / feedback.limit).square().mean().sqrt())
