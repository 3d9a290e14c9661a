"""A small network that proposes a plan from the latent state, the last plan and the cost's weights.

Its loss is the cost of what it proposes, so that it needs no converged plans and no choice among several minima: the
reference's gradient along the plan goes back into the network. Lessons are control steps of recordings under control,
with random weights of the cost, each from the plan that the release's optimiser would have made before.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from torch import nn

from benchmarks.common.command_line import track
from benchmarks.controller.operations.road import Problem, Road
from benchmarks.controller.operations.sequences import Sequences
from contract.arrays import Array
from export.reference.mpc import gradient

WIDTH: Final = 96
_LEAD: Final = 10
_FACTOR: Final = 3.0
"""Weights of the cost are drawn up to so many times larger or smaller."""
_FLOOR: Final = 1e-3


@dataclass(frozen=True, eq=False)
class LearnedStart:
    """The network with the shifted plan added to what it answers; inputs as `_inputs` makes them."""

    network: nn.Module
    scale: Array

    @property
    def multiply_accumulates(self) -> int:
        return sum(item.numel() for item in self.network.parameters() if item.ndim > 1)

    def __call__(self, problem: Problem) -> Array:
        with torch.no_grad():
            offset = self.network(_inputs(problem, self.scale)).numpy()
        return np.asarray(problem.start + problem.program.action_limit * offset)


def learn(sequences: Sequences, road: Road, *, weight_sets: int, passes: int, seed: int) -> LearnedStart:
    """Teach a network on these sequences, with so many random sets of cost weights, each seen so often."""
    rng = np.random.default_rng(seed)
    torch.manual_seed(seed)
    lessons = []
    for _ in track(range(weight_sets), "lessons of the warm start", "weights"):
        weights = random_weights(np.array(sequences.program.mpc.weights.as_tuple()), rng)
        lessons += [problem for problem, _ in sequences.travelled(road, weights)][_LEAD:]
    scale = np.concatenate([lesson.z for lesson in lessons]).std(axis=0)
    # It begins with the shifted plan itself.
    last = nn.Linear(WIDTH, sequences.program.mpc.horizon)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    network = nn.Sequential(
        *(nn.Linear(_inputs(lessons[0], scale).shape[1], WIDTH), nn.ELU()),
        *(nn.Linear(WIDTH, WIDTH), nn.ELU(), last),
    )
    _fit(network, lessons, scale, passes, rng)
    return LearnedStart(network.eval(), scale)


def random_weights(about: Array, rng: np.random.Generator) -> Array:
    """Weights of the cost around these, (7,); those that are 0 stay so."""
    return np.asarray(about * _FACTOR ** rng.uniform(-1.0, 1.0, about.shape))


def _fit(
    network: nn.Sequential, lessons: Sequence[Problem], scale: Array, passes: int, rng: np.random.Generator
) -> None:
    order = np.concatenate([rng.permutation(len(lessons)) for _ in range(passes)])
    optimiser = torch.optim.Adam(network.parameters(), lr=2e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, max_lr=2e-3, total_steps=len(order))
    for number in track(order, "training of the warm start", "steps"):
        lesson = lessons[number]
        limit = lesson.program.action_limit
        offset = network(_inputs(lesson, scale))
        plan = np.where(lesson.free, lesson.start + limit * offset.detach().numpy(), lesson.start)
        slope = gradient(lesson.program, lesson.z, plan, lesson.previous_action, lesson.weights)
        # Every set of weights counts the same, however large they are.
        slope = np.where(lesson.free, slope, 0.0) * limit / np.abs(lesson.weights).sum()
        # Beyond the limit the cost is the projected plan's; the overshoot is pulled back.
        over = np.clip(np.abs(plan) - limit, 0.0, None) * np.sign(plan)
        optimiser.zero_grad()
        offset.backward(torch.from_numpy((slope + over).astype(np.float32)) / len(plan))
        optimiser.step()
        schedule.step()


def _inputs(problem: Problem, scale: Array) -> torch.Tensor:
    """(n, n_z + H + 1 + 7): all of about unit size."""
    limit = problem.program.action_limit
    weights = np.log10(problem.weights + _FLOOR)
    columns = [
        problem.z / scale,
        problem.start / limit,
        problem.previous_action[:, None] / limit,
        np.broadcast_to(weights, (len(problem.z), len(weights))),
    ]
    return torch.from_numpy(np.concatenate(columns, axis=1).astype(np.float32))
