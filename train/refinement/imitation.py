"""Imitation: a prior takes over what other priors do at other speeds, and stays as it is at the design speed.

A training over all speeds improves a prior at some speeds and makes it worse at others. So priors that are good at some
speeds run in closed loop there, and the scheduled weights below or above the design speed are fitted to their actions.
These weights are multiplied by the distance from the design speed, so they have no effect there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from torch import Tensor

from contract.arrays import Array
from contract.controller.goal import SPEED_PLACES, Goal, schedule
from contract.differentiable import DifferentiableFlow, FlowState
from train.refinement.feedback import Feedback
from train.refinement.windows import Stream, StretchReadings, closed_loop

PERIODS_AT_ONCE: Final = 100
"""Periods that the tape stores at once."""
RAMP: Final = 40
"""Periods over which the speed changes from the design speed."""
OPTIMISER_STEPS: Final = 400
"""Steps of the optimiser (L-BFGS)."""
SMALL: Final = 1e-3
"""Price of the mean squared change of the weights, relative to the mean squared error of the action divided by its
limit. It determines the weights that the demonstrations do not."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Demonstration:
    """What a prior read and did in n control periods: (n, M, 2 p + 1) rows and (n,) actions in units of the present
    speed, (n,) speeds in units of the design speed, and (n,) drag coefficients after the periods."""

    rows: Tensor
    speeds: Array
    actions: Tensor
    Cd: Array


def demonstrate(
    flow: DifferentiableFlow, feedback: Feedback, start: FlowState, speed: float, goal: Goal, *, periods: int
) -> Demonstration:
    """Run a feedback in closed loop from a developed wake: a ramp to a constant speed, then `periods` at this speed.
    Raises PlantError if the flow diverged."""
    stream = Stream.begun(start, feedback, min(1.0, speed))
    stream.goal = goal
    course = np.concatenate([np.linspace(1.0, speed, RAMP + 1), np.full(periods, speed)])
    rows, speeds, actions, Cd = list[Tensor](), list[float](), list[float](), list[float]()
    with torch.no_grad():
        for first in range(0, len(course) - 1, PERIODS_AT_ONCE):
            part = course[first : first + PERIODS_AT_ONCE + 1]
            run = closed_loop(
                flow,
                feedback,
                stream,
                StretchReadings.plain(len(part) - 1, feedback.pairs),
                speeds=part,
                action_limit=goal.share_of_limit() * feedback.limit,
            )
            for window, told, action in run.read:
                rows.append(window)
                speeds.append(told)
                actions.append(float(action))
            Cd += [one.Cd for one in run.seen[1:]]
    return Demonstration(
        rows=torch.stack(rows),
        speeds=np.array(speeds),
        actions=torch.tensor(actions, dtype=torch.float64),
        Cd=np.array(Cd),
    )


def imitate(feedback: Feedback, given: Sequence[Demonstration], goal: Goal, *, faster: bool) -> tuple[float, float]:
    """Fit the feedback's scheduled weights of one side of the design speed, in place, to demonstrations with this goal
    at speeds of this side: above the design speed if `faster`. Returns the root mean square of the error, and of the
    action, divided by the action's limit."""
    place = SPEED_PLACES[faster]
    speeds = np.concatenate([one.speeds for one in given])
    scheduled = torch.tensor([schedule(float(speed), goal) for speed in speeds], dtype=torch.float64)
    odd, even = feedback.features(torch.cat([one.rows for one in given]))
    wanted, limit = torch.cat([one.actions for one in given]), goal.share_of_limit() * feedback.limit
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
        return (done / feedback.limit).square().mean()

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
