"""Fit a model's prior so that wrong speeds cost less drag reduction.

    python -m benchmarks.release.wrong_speeds OUTPUT --model MODEL

The fitted prior receives a speed that is up to 10 % wrong or leaves out a gust. It must act as the original prior acts
with the right speed or `BEST_TOLD`. In the first round the original prior runs in closed loop with the right speed, and
its inputs are scaled with wrong speeds; in later rounds the fitted prior runs with wrong speeds (dataset aggregation:
Ross, Gordon and Bagnell, 2011). Each fit uses all rounds. At the design speed, if the speed is right, the prior stays
the same. At last, the air speed's estimate is fitted to the fitted prior (`train.refinement.air_speed`).
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from contract.arrays import Array
from contract.config.tree import Config
from contract.controller.goal import Goal
from contract.differentiable import DifferentiableFlow, FlowState
from contract.errors import ModelError
from contract.model import model_folder
from contract.model.model_folder import AIR_SPEED
from contract.side_by_side import process_pool
from stillwake.console.terminal import make_console
from stillwake.parts.differentiable_wake import differentiable_wake
from train import model_store
from train.fitting.fit import torch_threads, without_denormals
from train.model_store import TrainedModel
from train.refinement import air_speed
from train.refinement.feedback import Feedback, scales_of
from train.refinement.imitation import Demonstration, demonstration, imitate, watch
from train.refinement.pipeline import middles_and_deviations

SPEEDS: Final = (0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4)
TOLD: Final = (0.9, 0.95, 1.0, 1.05, 1.1)
"""Ratios of the speed that the prior receives to the true speed."""
BEST_TOLD: Final = {0.8: 0.95}
"""The ratio, by true speed, with which the prior of `truck-wake-14` causes less drag than with the right speed."""
GUST, GUST_PERIOD = 0.1, 100
"""Amplitude of the gusts in design speeds, and their period in control periods."""
RAMP, PERIODS = 40, 600
"""Number of control periods over which the speed changes from the design speed, and number of periods after that."""
STARTS: Final = 8
ROUNDS: Final = 3
SEED: Final = 0


class Course(NamedTuple):
    """The true speeds of a run, shape (n + 1,). The priors receive these speeds times `told` (n,) or `expert_told`."""

    name: str
    speeds: Array
    told: Array
    expert_told: float = 1.0


def steady(speed: float, told: float) -> Course:
    """Return a course that leads from the design speed to a steady speed."""
    speeds = np.concatenate([np.linspace(1.0, speed, RAMP), np.full(PERIODS, speed)])
    return Course(f"{speed} told {told}", speeds, np.full(len(speeds) - 1, told), BEST_TOLD.get(speed, 1.0))


def gusty(speed: float) -> Course:
    """Return a course with gusts at a steady ground speed; the prior receives the speed without the gusts."""
    course = steady(speed, 1.0)
    gusts = GUST * np.sin(2.0 * np.pi * np.arange(len(course.speeds)) / GUST_PERIOD)
    speeds = course.speeds + gusts
    return Course(f"{speed} with gusts", speeds, (course.speeds / speeds)[:-1])


def feedback_of(model: TrainedModel) -> Feedback:
    """Return the model's prior as a feedback controller. Raises ModelError if the model has no prior."""
    if model.prior is None or "filters" not in model.prior:
        raise ModelError("the model has no prior: train it with `stillwake refine` first")
    middles, deviations = middles_and_deviations(model, model.sensors)
    limit = model.config.flow.action_limit
    scales = scales_of(deviations[::2].tolist(), limit)
    made = Feedback(len(model.prior["filters"]), len(model.prior["output"]), scales, middles, limit, seed=0)
    made.begin_with(model.prior)
    return made


def demonstrations_of(
    run: tuple[Course, Sequence[Array]], *, model: TrainedModel, prior: Mapping[str, Array] | None, start: int
) -> list[Demonstration]:
    """Run a course from the initial state with this number; return the actions of the model's prior with `expert_told`
    in its states. `run` has the course and, for each demonstration, the factors `told` of its input. `prior` runs with
    `told` of the course; if it is None, the model's prior runs with `expert_told`."""
    course, ratios = run
    goal, expert = Goal.of(model.config.mpc.weights), feedback_of(model)
    with torch_threads(1), without_denormals():
        flow, starts = _flow(model.config, tuple(model.sensors))
        driver, told = expert, np.full(len(course.told), course.expert_told)
        if prior is not None:
            driver, told = feedback_of(replace(model, prior={**(model.prior or {}), **prior})), course.told
        seen = watch(flow, driver, starts[start % STARTS], course.speeds, goal, told=told)
        found = [demonstration(seen, expert, goal, told=each, expert_told=course.expert_told) for each in ratios]
    drag = seen.Cd[len(seen.Cd) // 4 :].mean()
    make_console().print(f"{course.name if prior else course.name.split()[0]}: Cd {drag:.3f}", soft_wrap=True)
    return found


def withstand(model: TrainedModel) -> TrainedModel:
    """Return the model with a prior that tolerates wrong speeds. Raises PlantError if the flow diverges."""
    student, goal = feedback_of(model), Goal.of(model.config.mpc.weights)
    courses = [*(steady(speed, told) for speed in SPEEDS for told in TOLD), *map(gusty, SPEEDS[1:-1])]
    right = [(steady(speed, 1.0), [steady(speed, told).told for told in TOLD]) for speed in SPEEDS]
    right += [(course, [np.ones(len(course.told)), course.told]) for course in map(gusty, SPEEDS[1:-1])]
    wrong = [(course, [course.told]) for course in courses]
    given, prior, tell = list[Demonstration](), None, make_console().print
    with process_pool(2, None) as pool:
        for number in range(ROUNDS):
            work = partial(demonstrations_of, model=model, prior=prior, start=number)
            given += [one for found in pool.map(work, wrong if number else right) for one in found]
            for faster, side in ((False, "below"), (True, "above")):
                error, action = imitate(student, given, goal, faster=faster)
                tell(f"{side} the design speed: rms error {error:.3f} of the limit, action {action:.3f}")
            prior = student.as_prior()
        model = replace(model, prior={**(model.prior or {}), **(prior or {})})
        found = pool.map(partial(seen_of, model=model), range(air_speed.RUNS))
        weights, error = air_speed.fit(list(found), student.pairs, seed=SEED)
    tell(f"estimate of the air speed: rms error {error:.4f}")
    return replace(model, prior={**(model.prior or {}), AIR_SPEED: weights})


def seen_of(number: int, *, model: TrainedModel) -> tuple[Array, Array]:
    """Run the model's prior with one wrong speed, for the estimate of the air speed."""
    with torch_threads(1), without_denormals():
        flow, starts = _flow(model.config, tuple(model.sensors))
        goal, settings = Goal.of(model.config.mpc.weights), replace(model.config.refine, streams=STARTS)
        return air_speed.run(flow, feedback_of(model), starts, settings, goal, seed=SEED, number=number)


@cache
def _flow(config: Config, sensors: tuple[str, ...]) -> tuple[DifferentiableFlow, list[FlowState]]:
    config = replace(config, refine=replace(config.refine, streams=STARTS))
    return differentiable_wake(config, sensors, None, lambda *_: None)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("output", type=Path)
    parser.add_argument("--model", type=Path, required=True, help="model whose prior is fitted")
    given = parser.parse_args()
    model_folder.check_free(given.output)
    model_store.save(given.output, withstand(model_store.load(given.model)))
