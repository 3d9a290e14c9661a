"""The training of the feedback with gradients through the flow solver, by Adam, with averaged weights.

A stream is a flow under the feedback; a stretch is an interval of a stream. Each update uses the next stretches of
several streams. A stretch is about as long as the flow takes from the jets to the end of the recirculation bubble and
back. The cost of motion in the far wake represents the effects after the stretch. Streams begin in the developed wake
and restart after some stretches, at different times, so that the training always includes both the transient from the
developed wake and the controlled wake.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor

from contract.arrays import Array
from contract.config.controller import CostWeights
from contract.config.learning import RefineConfig
from contract.controller.goal import Goal
from contract.differentiable import DifferentiableFlow, FlowState
from contract.side_by_side import process_pool
from train.fitting.progress import Phase, Progress, silent
from train.fitting.unfinished import Checkpoints, Reached
from train.refinement.feedback import Feedback
from train.refinement.windows import Price, Stream, Stretch, StretchReadings, Task, differentiate

SideBySide = Callable[[Sequence[Task]], Sequence[Stretch]]


@contextmanager
def side_by_side(workers: int, flow: Callable[[], DifferentiableFlow]) -> Iterator[SideBySide]:
    """Start processes, each with its own plant from `flow`; yield a function that runs tasks in these processes."""
    with process_pool(workers, partial(_begin, flow)) as pool:
        yield lambda tasks: list(pool.map(_run, tasks))


_FLOW: list[DifferentiableFlow] = []
"""The plant of a worker process."""


def _begin(flow: Callable[[], DifferentiableFlow]) -> None:
    torch.set_num_threads(1)
    # `train.fitting.fit.without_denormals` switches this off again. Here it stays on until the process ends.
    torch.set_flush_denormal(True)
    _FLOW.append(flow())


def _run(task: Task) -> Stretch:
    return differentiate(_FLOW[0], task)


LARGEST_GRADIENT: Final = 0.5
"""Norm to which a stretch's gradient is clipped, because some stretches have ten times the usual norm."""
MEAN_OVER: Final = 30
"""Time constant, in updates, of the exponential mean of the weights: after this time an update has the share 1 / e."""
KEEP_EVERY: Final = 5
SPEED_CHANGE: Final = 0.25
"""Change of speed in a stretch, as a fraction of the distance to a drawn speed, in a random half of them."""
AT_DESIGN: Final = 3
"""Every n-th stream (n is this value) stays at the design speed, because a release is tested first at this speed."""
GOAL_OVER: Final = 3
"""Number of stretches after which a stream gets a new goal; the wake takes about one stretch to respond."""
SOUND: Final = 0.5
"""Probability of three independent events: true speed in a stretch, no lost frame, a part of the goal as configured."""
LAST_ROWS: Final = 20_000
"""Number of the newest control periods to which the predictor of differences is fitted."""
NEAR_DESIGN: Final = 0.1
"""Largest relative distance from the design speed at which a stretch is used to fit the predictor. One linear predictor
for speeds from 0.6 to 1.4 had an error of 0.063 in Cp over eight steps; a predictor for the design speed has 0.035
(manual run, truck-wake-8). With a known delay of twelve periods, the predictor for all speeds led to a mean |Cl| of
1.14 under control."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Refined:
    """The feedback with averaged weights, and the number of control periods that the plant simulated. `stretches` has
    an array (n, p + 1) for each of the newest stretches near the design speed, or at any speed if none is near. Each of
    n control periods has a row: p pressure differences and the action."""

    feedback: Feedback
    stretches: tuple[Array, ...]
    periods: int


class _Training:
    def __init__(self, make: Callable[[], Feedback], starts: Sequence[FlowState], settings: RefineConfig) -> None:
        self.feedback, self.mean = make(), make()
        self.optimiser = torch.optim.Adam(self.feedback.parameters(), lr=settings.learning_rate)
        self.streams = [Stream.begun(start, self.feedback, settings.slowest) for start in starts]
        self.stretches, self.off_design = list[Array](), list[Array]()
        self.done = self.periods = 0

    def as_tree(self) -> dict[str, Any]:
        return {
            **{name: getattr(self, name).state_dict() for name in _LEARNED},
            "streams": [_stored(one) for one in self.streams],
            "rows": [torch.from_numpy(one) for one in self.stretches],
            "off_design": [torch.from_numpy(one) for one in self.off_design],
            "done": self.done,
            "periods": self.periods,
        }

    def take(self, tree: dict[str, Any]) -> None:
        for name in _LEARNED:
            getattr(self, name).load_state_dict(tree[name])
        self.streams = [_stream(one) for one in tree["streams"]]
        self.stretches = [one.numpy() for one in tree["rows"]]
        self.off_design = [one.numpy() for one in tree["off_design"]]
        self.done, self.periods = tree["done"], tree["periods"]


_LEARNED: Final = ("feedback", "mean", "optimiser")


def _stored(stream: Stream) -> dict[str, Any]:
    fields = {**vars(stream), **vars(stream.state), "goal": tuple(stream.goal)}
    del fields["state"]
    return {name: torch.from_numpy(value) if isinstance(value, np.ndarray) else value for name, value in fields.items()}


def _stream(stored: Mapping[str, Any]) -> Stream:
    fields: dict[str, Any] = {
        name: value.numpy() if isinstance(value, Tensor) else value for name, value in stored.items()
    }
    state = FlowState(flat=fields.pop("flat"), action=fields.pop("action"))
    return Stream(**{**fields, "state": state, "goal": Goal(*fields["goal"])})


def refine(
    make: Callable[[], Feedback],
    flow: DifferentiableFlow,
    starts: Sequence[FlowState],
    settings: RefineConfig,
    deviations: Array,
    *,
    seed: int,
    side_by_side: SideBySide | None = None,
    progress: Progress = silent,
    checkpoints: Checkpoints | None = None,
) -> Refined:
    """Train the feedback, or continue an interrupted training. Raises PlantError if the flow diverged or a stretch is
    too long for the tape's memory; StillwakeError if a checkpoint is damaged or cannot be written.

    `make` returns the initial feedback. `starts` are developed wakes without jets, one for each stream. `deviations` (2
    p,) are the standard deviations of Cp at the sensors of p pairs, the units of the sensors' noise. `side_by_side`
    runs an update's stretches in parallel; if None, they run in turn on `flow`. An update's random draws depend only on
    the seed and the update's number.
    """
    run = _Training(make, starts, settings)
    if checkpoints is not None and (tree := checkpoints.load(Phase.REFINE)):
        run.take(tree)
    while run.done < settings.updates:
        tasks = _tasks(run, starts, settings, deviations, np.random.default_rng([seed, run.done]))
        finished = [differentiate(flow, task) for task in tasks] if side_by_side is None else side_by_side(tasks)
        _update(run, finished, settings, progress)
        if checkpoints is not None and (run.done % KEEP_EVERY == 0 or run.done == settings.updates):
            reached = Reached(phase=Phase.REFINE, step=run.done, total=settings.updates)
            checkpoints.save(Phase.REFINE, run.as_tree(), reached)
    return Refined(feedback=run.mean, stretches=tuple(run.stretches or run.off_design), periods=run.periods)


def _tasks(
    run: _Training, starts: Sequence[FlowState], settings: RefineConfig, deviations: Array, rng: np.random.Generator
) -> list[Task]:
    course = run.done / settings.updates
    at_design = settings.shortest + (settings.longest - settings.shortest) * min(1.0, 2.0 * course)
    tasks = []
    for place in range(settings.batch):
        number = (run.done * settings.batch + place) % len(run.streams)
        if run.streams[number].stretches >= settings.stretches + 2 * number:
            start = starts[int(rng.integers(len(starts)))]
            run.streams[number] = Stream.begun(start, run.feedback, settings.slowest)
        stream = run.streams[number]
        if stream.stretches % GOAL_OVER == 0:
            stream.goal = _next_goal(settings, rng)
        effort, lift = stream.goal.prices()
        is_fixed = settings.slowest == settings.fastest or number % AT_DESIGN == 0
        speed = 1.0 if is_fixed else _next_speed(stream, settings, rng)
        # The jets' effect takes the same number of convective times, and so fewer periods at a higher speed.
        periods = round(2.0 * at_design / (stream.speed + speed))
        speeds = np.linspace(stream.speed, speed, periods + 1)
        tasks.append(
            Task(
                number=number,
                feedback=run.feedback,
                stream=stream,
                price=Price(lift=lift, motion=settings.motion_price, effort=effort),
                readings=_readings(settings, deviations, speeds[:-1], rng),
                speeds=speeds,
            )
        )
    return tasks


def _next_goal(settings: RefineConfig, rng: np.random.Generator) -> Goal:
    own = Goal.of(CostWeights(lift=settings.lift_price, effort=settings.effort_price))
    drawn, others = rng.random(len(own)), rng.random(len(own)) > SOUND
    return Goal(*np.where(others, drawn, own).tolist()) if settings.goals else own


def _readings(settings: RefineConfig, deviations: Array, speeds: Array, rng: np.random.Generator) -> StretchReadings:
    """Draw a stretch's sensor errors, speed errors and lost frames. `speeds` (n,) are the flow's speeds."""
    periods = len(speeds)
    # The square of a uniform draw makes low noise frequent.
    scale = settings.sensor_noise * rng.random() ** 2
    noise = scale * deviations * rng.standard_normal((periods, len(deviations)))
    # Both sensors of a pair get equal offsets, because an offset of their difference would look like a steady lift.
    noise += np.repeat(settings.offset * rng.standard_normal(len(deviations) // 2), 2)
    told, share = rng.uniform(-1.0, 1.0) * (rng.random() > SOUND), rng.random() * (rng.random() > SOUND)
    return StretchReadings(
        noise=noise,
        # The speed that the feedback receives is limited to the trained range, as in the ECU.
        told=np.clip((1.0 + settings.speed_error * told) * speeds, settings.slowest, settings.fastest) / speeds,
        lost=rng.random(periods) < settings.loss * share,
    )


def _next_speed(stream: Stream, settings: RefineConfig, rng: np.random.Generator) -> float:
    """Return the speed at a stretch's end; in a stream's first stretch, it is a random speed."""
    # A random speed outside the range is limited to the range, so that the ends of the range are frequent.
    beyond = 0.3 * (settings.fastest - settings.slowest)
    anywhere = rng.uniform(settings.slowest - beyond, settings.fastest + beyond)
    anywhere = float(np.clip(anywhere, settings.slowest, settings.fastest))
    share = 1.0 if stream.stretches == 0 else SPEED_CHANGE * float(rng.integers(2))
    return stream.speed + share * (anywhere - stream.speed)


def _update(run: _Training, results: Sequence[Stretch], settings: RefineConfig, progress: Progress) -> None:
    for group in run.optimiser.param_groups:
        group["lr"] = settings.learning_rate * settings.last_rate ** (run.done / settings.updates)
    cut = [_cut(one.gradients) for one in results]
    for number, parameter in enumerate(run.feedback.parameters()):
        parameter.grad = torch.stack([one[number] for one in cut]).mean(dim=0)
    run.optimiser.step()
    run.done += 1
    for one in results:
        run.streams[one.number] = one.stream
        near = one.off_design <= NEAR_DESIGN
        (run.stretches if near else run.off_design).append(one.rows)
        run.periods += one.periods
    for kept in (run.stretches, run.off_design):
        while sum(map(len, kept)) > LAST_ROWS:
            kept.pop(0)
    with torch.no_grad():
        share = 1.0 / MEAN_OVER if run.done > MEAN_OVER else 1.0
        for slow, new in zip(run.mean.parameters(), run.feedback.parameters(), strict=True):
            slow.lerp_(new, share)
    means = {name: float(np.mean([getattr(one, name) for one in results])) for name in ("Cd", "abs_Cl")}
    progress(Phase.REFINE, run.done, settings.updates, {"Cd": means["Cd"], "abs Cl": means["abs_Cl"]})


def _cut(gradients: Sequence[Tensor]) -> list[Tensor]:
    norm = float(torch.stack([one.norm() for one in gradients]).norm())
    return [one * min(1.0, LARGEST_GRADIENT / (norm + 1e-6)) for one in gradients]
