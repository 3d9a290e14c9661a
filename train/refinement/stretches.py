"""The stretches (intervals of closed loop) of an update, computed in this process or in parallel processes."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import Tensor

from contract.arrays import Array
from contract.differentiable import DifferentiableFlow
from contract.side_by_side import process_pool
from train.refinement.feedback import Feedback
from train.refinement.windows import Price, Stream, Stretch, StretchReadings, differentiate


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A stretch of the stream with this number that will be run, with arguments of `differentiate`."""

    number: int
    feedback: Feedback
    stream: Stream
    price: Price
    readings: StretchReadings
    speeds: Array
    action_limit: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Done:
    """A stretch that has been run: the stream after it, and the gradients with respect to the feedback's parameters, in
    their order."""

    number: int
    stream: Stream
    stretch: Stretch
    gradients: tuple[Tensor, ...]


SideBySide = Callable[[Sequence[Task]], Sequence[Done]]


def done(task: Task, flow: DifferentiableFlow) -> Done:
    """Run a stretch; raises PlantError as `differentiate` does."""
    feedback, stream = task.feedback, replace(task.stream)
    feedback.zero_grad()
    stretch = differentiate(
        flow, feedback, stream, task.price, task.readings, speeds=task.speeds, action_limit=task.action_limit
    )
    gradients = tuple(one.grad.clone() for one in feedback.parameters() if one.grad is not None)
    return Done(number=task.number, stream=stream, stretch=stretch, gradients=gradients)


@contextmanager
def side_by_side(workers: int, flow: Callable[[], DifferentiableFlow]) -> Iterator[SideBySide]:
    """Start processes that each have their own plant, which `flow` creates."""
    with process_pool(workers, partial(_begin, flow)) as pool:
        yield lambda tasks: list(pool.map(_run, tasks))


_FLOW: list[DifferentiableFlow] = []
"""The plant of a worker process."""


def _begin(flow: Callable[[], DifferentiableFlow]) -> None:
    torch.set_num_threads(1)
    # Unlike in `without_denormals`, the setting stays for the life of the process.
    torch.set_flush_denormal(True)
    _FLOW.append(flow())


def _run(task: Task) -> Done:
    return done(task, _FLOW[0])
