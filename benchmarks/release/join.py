"""Fit a model's prior (the base) to the actions of other models' priors (the experts) at other speeds.

    python -m benchmarks.release.join OUTPUT --base MODEL --expert 0.6 MODEL --expert 1.4 MODEL ...

Each expert runs in closed loop on the mesh of `stillwake refine`, at its speed, from two phases of the developed wake.
Then the base's prior is fitted to the experts' actions (`train.refinement.imitation`). At the design speed the prior
stays the same. The base's networks, sensors and configuration, and the prior's parts for the goal, never change.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from contract.config.tree import Config
from contract.controller.goal import Goal
from contract.errors import ModelError
from contract.model import model_folder
from contract.side_by_side import process_pool
from stillwake.console.terminal import make_console
from stillwake.parts.differentiable_wake import differentiable_wake
from train import model_store
from train.fitting.fit import torch_threads, without_denormals
from train.model_store import TrainedModel
from train.refinement.feedback import Feedback, scales_of
from train.refinement.imitation import Demonstration, demonstration, imitate, watch
from train.refinement.pipeline import middles_and_deviations

PERIODS: Final = 1000
"""Number of periods of an expert's run: 200 convective times at the design speed. At 60 % of the design speed, the mean
drag becomes constant in half of this time."""
STARTS: Final = 2
RAMP: Final = 40
"""Number of periods over which the speed changes from the design speed to an expert's speed."""


def feedback_of(model: TrainedModel, base: TrainedModel) -> Feedback:
    """Return the prior of `model` as a feedback controller with the scales of `base`. Raises ModelError if a model has
    no prior, or if the two models differ in their sensors or in the memory of their priors."""
    if model.prior is None or base.prior is None or "filters" not in model.prior:
        raise ModelError("the model has no prior: train it with `stillwake refine` first")
    if model.sensors != base.sensors:
        raise ModelError(f"the model has sensors {', '.join(model.sensors)}; the base has {', '.join(base.sensors)}")
    memory, needed = len(model.prior["filters"]), len(base.prior["filters"])
    if memory != needed:
        raise ModelError(f"the prior reads {memory} rows; the base's prior reads {needed}")
    middles, deviations = middles_and_deviations(base, base.sensors)
    limit = base.config.flow.action_limit
    scales = scales_of(deviations[::2].tolist(), limit)
    made = Feedback(memory, len(model.prior["output"]), scales, middles, limit, seed=0)
    made.begin_with(model.prior)
    return made


def demonstrations_of(
    speed: float, expert: Path, *, base: TrainedModel, config: Config, goal: Goal
) -> list[Demonstration]:
    """Run an expert's prior in closed loop from each initial state. Raises PlantError if the flow diverges."""
    feedback = feedback_of(model_store.load(expert), base)
    with torch_threads(1), without_denormals():
        flow, starts = differentiable_wake(config, base.sensors, None, lambda *_: None)
        speeds = np.concatenate([np.linspace(1.0, speed, RAMP), np.full(PERIODS, speed)])
        right = np.ones(len(speeds) - 1)
        runs = [watch(flow, feedback, start, speeds, goal, told=right) for start in starts]
    late = [float(one.Cd[PERIODS // 5 :].mean()) for one in runs]
    make_console().print(f"{expert} at {speed}: Cd {', '.join(f'{Cd:.3f}' for Cd in late)}", soft_wrap=True)
    return [demonstration(one, feedback, goal, told=right) for one in runs]


def join(base: TrainedModel, experts: Sequence[tuple[float, Path]], *, workers: int = 2) -> TrainedModel:
    """Return the base with a prior that imitates each expert near the expert's speed. Raises ModelError as
    `feedback_of` does, and if an expert's speed is the design speed; PlantError if the flow diverged."""
    if any(speed == 1.0 for speed, _ in experts):
        raise ModelError("an expert's speed is 1, where the base stays the same: give another speed")
    config = replace(base.config, refine=replace(base.config.refine, streams=STARTS))
    goal = Goal.of(config.mpc.weights)
    student = feedback_of(base, base)
    with process_pool(workers, None) as pool:
        speeds, paths = zip(*experts, strict=True)
        demonstrations = list(pool.map(partial(demonstrations_of, base=base, config=config, goal=goal), speeds, paths))
    fit(student, [one for found in demonstrations for one in found], goal)
    return replace(base, prior={**(base.prior or {}), **student.as_prior()})


def fit(student: Feedback, given: Sequence[Demonstration], goal: Goal) -> None:
    """Fit the student's prior to demonstrations on each side of the design speed, and print the errors."""
    for faster, side in ((False, "below"), (True, "above")):
        if any(((one.speeds > 1.0) == faster).any() for one in given):
            error, action = imitate(student, given, goal, faster=faster)
            make_console().print(f"{side} the design speed: rms error {error:.3f} of the limit, action {action:.3f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("output", type=Path)
    parser.add_argument("--base", type=Path, required=True, help="model whose prior is fitted")
    parser.add_argument("--expert", nargs=2, action="append", required=True, metavar=("SPEED", "MODEL"))
    given = parser.parse_args()
    model_folder.check_free(given.output)
    pairs = [(float(speed), Path(model)) for speed, model in given.expert]
    model_store.save(given.output, join(model_store.load(given.base), pairs))
