"""The fit of the air-speed estimate: a linear regression over closed loops in which a prior is told wrong speeds.

True and told speeds are drawn at random. The regression estimates the logarithm of told speed / true speed from means
of products of pressures and actions (`contract.controller.air_speed`).
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from contract.arrays import Array
from contract.config.learning import RefineConfig
from contract.controller.air_speed import FIRST_PERIOD, LAGS, MEAN_PERIODS, features, terms
from contract.controller.goal import Goal
from contract.differentiable import DifferentiableFlow, FlowState
from train.refinement.feedback import Feedback
from train.refinement.imitation import rows_as_told, watch

RUNS: Final = 40
RUN_PERIODS: Final = 900
RAMP: Final = 40
"""Number of periods over which the speed changes from the design speed to a run's first speed."""
CHANGE: Final = 1e-3
"""Mean change of speed per period of a ramp, in units of the design speed. A ramp over all speeds then takes 16 s."""
SPEEDS_BEYOND: Final = 0.2
"""Distance by which a drawn speed may lie outside the range of speeds, as a share of the range."""
MOST_WRONG: Final = 0.12
"""Largest error of a told speed, as a share of the true speed."""
DESIGN_SPEED_EVERY: Final = 8
"""Step of the run numbers with the design speed as true and told speed; a release is judged at this speed first."""
RIGHT_SHARE: Final = 0.3
"""Probability that the told speed is right in each of the other runs."""
OFFSET: Final = 0.02
"""Standard deviation, in Cp, of the random offset of a pair's sum. A run is used `COPIES` times, with new offsets."""
COPIES: Final = 4
EVERY: Final = 10
"""Number of periods between two equations of the regression. The inputs, running means, change little in this time."""
WEIGHT_COST: Final = 1e-3
"""The ridge parameter, relative to the number of equations, for terms with a variance of 1."""


def wrong_speeds(number: int, slowest: float, fastest: float, *, seed: int) -> tuple[Array, Array]:
    """Draw the speeds of the run with this number. The true speed has steady parts and ramps within the range. The told
    speed is a constant multiple of the true speed, but limited to the range. Returns the true speeds (n + 1,) at the
    samples of n control periods, in units of the design speed and beginning with 1, and told / true speed (n,)."""
    if number % DESIGN_SPEED_EVERY == 0:
        return np.ones(RUN_PERIODS + 1), np.ones(RUN_PERIODS)
    rng = np.random.default_rng([seed, number])
    # A drawn speed outside the range is limited to the range, so that the ends of the range are frequent.
    beyond = SPEEDS_BEYOND * (fastest - slowest)

    def draw() -> float:
        return float(np.clip(rng.uniform(slowest - beyond, fastest + beyond), slowest, fastest))

    speed = draw()
    parts = [np.linspace(1.0, speed, RAMP)]
    while sum(map(len, parts)) <= RUN_PERIODS:
        if rng.random() < 0.5:
            parts.append(np.full(int(rng.integers(200, 500)), speed))
        else:
            end = draw()
            parts.append(np.linspace(speed, end, 2 + int(abs(end - speed) / (CHANGE * rng.uniform(0.5, 1.5)))))
            speed = end
    true = np.concatenate(parts)[: RUN_PERIODS + 1]
    ratio = 1.0 if rng.random() < RIGHT_SHARE else rng.uniform(1.0 - MOST_WRONG, 1.0 + MOST_WRONG)
    # The told speed is limited to the range, as in the ECU.
    return true, np.clip(ratio * true[:-1], slowest, fastest) / true[:-1]


def run(
    flow: DifferentiableFlow,
    feedback: Feedback,
    starts: Sequence[FlowState],
    settings: RefineConfig,
    goal: Goal,
    *,
    seed: int,
    number: int,
) -> tuple[Array, Array]:
    """Return the inputs of the regression from the run with this number: features (m, F) of m periods, and the
    logarithm of the told speed divided by the true speed, (m,). Raises PlantError if the flow diverges."""
    true, told = wrong_speeds(number, settings.slowest, settings.fastest, seed=seed)
    seen = watch(flow, feedback, starts[number % len(starts)], true, goal, told=told)
    read = rows_as_told(seen, told, memory=max(LAGS) + 2)
    rows = np.stack([each.numpy() for each, _ in read])
    pairs = (rows.shape[2] - 1) // 2
    differences, sums = rows[:, 1:, :pairs], rows[:, 1:, pairs:-1]
    window = np.empty_like(rows[:, 1:])
    window[..., 0:-1:2], window[..., 1:-1:2] = (sums + differences) / 2.0, (sums - differences) / 2.0
    # In a row of the ECU, the action is the action in force at the row's sample; in `rows` it is the next action.
    window[..., -1] = rows[:, :-1, -1]
    return features(window), np.log(told[-len(read) :])


def fit(found: Sequence[tuple[Array, Array]], pairs: int, *, seed: int) -> tuple[Array, float]:
    """Fit the weights of the estimate's terms to the results of `run` for all runs, by ridge regression. Returns the
    weights, and the rms error of the estimate in these runs."""
    rng, equations, wanted = np.random.default_rng(seed), list[Array](), list[Array]()
    for seen, logarithm in found:
        means = _running_means(seen)[FIRST_PERIOD::EVERY]
        for _ in range(COPIES):
            moved = means.copy()
            moved[:, :pairs] += OFFSET * rng.standard_normal(pairs)
            equations.append(terms(moved, pairs))
            wanted.append(logarithm[FIRST_PERIOD::EVERY])
    all_terms, right = np.concatenate(equations), np.concatenate(wanted)
    scaled, middle = all_terms[:, :-1], right.mean()
    mean, deviation = scaled.mean(axis=0), scaled.std(axis=0)
    # If the jets stay shut in all runs, some terms are always 0, so their deviation is 0.
    deviation[deviation == 0.0] = 1.0
    scaled = (scaled - mean) / deviation
    normal = scaled.T @ scaled + WEIGHT_COST * len(scaled) * np.eye(scaled.shape[1])
    weights = np.linalg.solve(normal, scaled.T @ (right - middle)) / deviation
    weights = np.append(weights, middle - weights @ mean)
    return weights, float(np.sqrt(np.mean(np.square(all_terms @ weights - right))))


def _running_means(values: Array) -> Array:
    means = values.copy()
    for k in range(1, len(values)):
        means[k] = means[k - 1] + (values[k] - means[k - 1]) / min(k + 1, MEAN_PERIODS)
    return means
