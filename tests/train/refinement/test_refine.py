"""Training through a flow: its gradient against differences, what it learns, and a stop that costs nothing."""

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from contract.config.learning import RefineConfig
from contract.config.tree import Config
from contract.controller.goal import Goal
from contract.errors import ConfigError, DatasetError, StillwakeError
from contract.sensors import TRUCK
from tests.each import each
from tests.train.refinement.oscillator import DRAG, MIDDLES, START, Oscillator
from train.fitting.progress import Phase, silent
from train.fitting.unfinished import Checkpoints, Identity
from train.refinement import pipeline
from train.refinement.feedback import Feedback
from train.refinement.pipeline import check_pairs, check_prices, predictor, resting_by_speed
from train.refinement.refine import Refined, _next_goal, refine
from train.refinement.windows import ROUNDED, Price, Stream, Stretch, StretchReadings, Task, differentiate

MEMORY, LIMIT = 6, 0.075
PRICE = Price(lift=0.3, motion=0.2, effort=5.0)
SETTINGS = RefineConfig(
    memory=MEMORY, units=4, updates=20, shortest=12, longest=20, streams=2, stretches=3, learning_rate=0.1
)


def feedback() -> Feedback:
    return Feedback(MEMORY, 4, (0.3, 0.3, 0.05), MIDDLES, LIMIT, 0)


@each("last", (1.6, 0.8))
def test_the_gradient_is_that_of_flow_and_feedback_together(last):
    """While the speed rises or falls, and is told wrongly, two frames are lost, and the goal is between all."""
    speeds, policy, goal = np.linspace(1.0, last, 13), feedback(), Goal(0.5, 0.3, 0.4)
    bound = goal.share_of_limit() * LIMIT
    noise, lost = 0.01 * np.random.default_rng(0).normal(size=(12, 4)), np.arange(12) // 2 == 3
    told = np.linspace(0.95, 1.05, 12)
    for seed, weights in enumerate(policy.parameters()):
        torch.nn.init.normal_(weights, 0.0, 0.6, generator=torch.Generator().manual_seed(seed))

    def cost() -> tuple[float, list[float]]:
        flow, committed, costs, commands = Oscillator(), 0.0, [], [0.0]
        raw = np.array([0.0, 0.0, *MIDDLES])
        rows, seen, past = [np.append(raw, 0.0)] * (MEMORY + 2), flow.begin(START), [1.0] * (MEMORY + 2)
        for k in range(len(noise)):
            speed = speeds[k] * told[k]
            past.append(speed)
            if not lost[k]:
                first, second = ((seen.Cp + noise[k]) / told[k] ** 2).reshape(2, 2).T
                raw = np.array([*(first - second), *(first + second)])
            rows.append(np.append(rows[-1][:-1] + min(1.0, speed) * (raw - rows[-1][:-1]), committed))
            travelled = np.cumsum([0.0, *past[:0:-1]])
            at = np.array([interpolated(travelled, np.array(rows[::-1]), step) for step in range(MEMORY)])[::-1]
            in_force = [rows[0][-1], *[row[-1] for row in rows[:-1]]] / np.array(past)
            acts = [interpolated(travelled, in_force[::-1], step) for step in range(MEMORY)][::-1]
            at[:, -1] = [*acts[1:], committed / speed]
            command = committed
            if not lost[k]:
                wanted = float(policy(torch.from_numpy(at.copy()), speed, goal).detach()) * speed
                command += min(1.0, speed**2) * (wanted - committed)
            commands.append(float(np.clip(command, -bound, bound)))
            seen, acted, committed = flow.advance(committed), committed, commands[-1]
            lift = np.sqrt(seen.Cl**2 + ROUNDED**2)
            costs.append(seen.Cd + PRICE.lift * lift + PRICE.motion * seen.Uy**2 + PRICE.effort * acted**2)
        return float(np.mean(costs)), commands

    # Followed pressures begin at the oldest row that is kept: long past, so that it does not show.
    stream = Stream.begun(START, policy, 0.4)
    stream.goal = goal
    readings = StretchReadings(noise=noise, told=told, lost=lost)
    task = Task(feedback=policy, stream=stream, price=PRICE, readings=readings, speeds=speeds)
    stretch = differentiate(Oscillator(), task)
    assert stretch.rows.shape == (int(sum(speeds[1:-1])) + 1, 3)
    commands = cost()[1]
    assert stretch.stream.committed == pytest.approx(commands[-1], rel=1e-5)
    assert commands[7:9] == [commands[6]] * 2 and np.ptp(commands) > 0.4 * bound
    assert (bound in np.abs(commands)) == (last > 1.0)
    first, gate = policy.first, policy.gate
    entries = [(first, (part, 2, 1)) for part in range(6)] + [(gate, (part, 1)) for part in (0, 1, 2, 3, 10, 13, 16)]
    for weights, index in ((policy.output, (3,)), (first, (0, 17, 0)), *entries):
        assert weights.grad is not None
        costs = []
        for step in (1e-5, -2e-5):
            with torch.no_grad():
                weights[index] += step
            costs.append(cost()[0])
        with torch.no_grad():
            weights[index] += 1e-5
        # The costs are of order one: their rounding, over twice the step, is some 1e-11.
        expected = pytest.approx((costs[0] - costs[1]) / 2e-5, rel=1e-5, abs=5e-11)
        assert float(weights.grad[index]) == expected, index


def interpolated(at: np.ndarray, values: np.ndarray, where: float) -> np.ndarray:
    """Between values (n, ...) at `at` (n,), rising."""
    return np.array([np.interp(where, at, column) for column in values.reshape(len(at), -1).T]).squeeze()


def trained(folder: Path | None = None, stop_at: int = 0) -> Refined:
    identity = Identity(settings="{}", dataset_sha256="")
    kept = None if folder is None else Checkpoints(folder=folder, identity=identity)

    def stop(phase: Phase, step: int, total: int, terms: Mapping[str, float]) -> None:
        if step == stop_at:
            raise KeyboardInterrupt

    return refine(
        feedback, Oscillator(), [START] * 2, SETTINGS, np.full(4, 0.1), seed=3, progress=stop, checkpoints=kept
    )


def drag(policy: Feedback) -> float:
    """Mean over the last half of 60 periods."""
    flow, committed, found = Oscillator(), 0.0, []
    rows, seen = [np.array([0.0, 0.0, *MIDDLES, 0.0])] * (MEMORY - 1), flow.begin(START)
    for _ in range(60):
        rows.append(np.array([*seen.differences, *(seen.Cp[::2] + seen.Cp[1::2]), committed]))
        with torch.no_grad():
            command = float(policy(torch.from_numpy(np.array(rows[-MEMORY:]))))
        seen, committed = flow.advance(committed), command
        found.append(seen.Cd)
    return float(np.mean(found[30:]))


@pytest.mark.slow
def test_it_learns_to_calm_the_oscillator_and_goes_on_after_a_stop(tmp_path):
    done = trained()
    before, after = drag(feedback()) - DRAG, drag(done.feedback) - DRAG
    assert after < 0.5 * before, (before, after)
    assert done.periods == sum(round(12 + 8 * min(1.0, k / 10)) for k in range(20))
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path / "kept", stop_at=13)
    again = trained(tmp_path / "kept")
    for kept, whole in zip(again.feedback.parameters(), done.feedback.parameters(), strict=True):
        np.testing.assert_array_equal(kept.detach().numpy(), whole.detach().numpy())
    assert again.periods == done.periods


def test_stretches_side_by_side_are_those_one_after_the_other():
    """As tasks go to a process, and their results come back."""
    settings = replace(SETTINGS, updates=3, batch=2, slowest=0.8, fastest=1.2, goals=True)
    settings = replace(settings, offset=0.1, speed_error=0.1, loss=0.3)
    given = (feedback, Oscillator(), [START] * 2, settings, np.full(4, 0.1))
    alone = refine(*given, seed=3)

    def run(tasks: Sequence[Task]) -> list[Stretch]:
        return [sent(differentiate(Oscillator(), sent(task))) for task in tasks]

    shared = refine(*given, seed=3, side_by_side=run)
    # The first stream stays at the design speed; the other has equal convective times.
    assert shared.periods == alone.periods and 1.0 / 1.2 <= alone.periods / (12 + 17 + 20) - 1.0 <= 1.0 / 0.8
    # The predictor is fitted near the design speed; three stretches of six go farther from it.
    assert len(alone.stretches) == 3
    for one, other in zip(shared.feedback.parameters(), alone.feedback.parameters(), strict=True):
        np.testing.assert_array_equal(one.detach().numpy(), other.detach().numpy())


def sent(thing: Any) -> Any:
    return pickle.loads(pickle.dumps(thing))


def test_a_speed_that_lies_is_told_within_the_range_so_that_a_streams_rows_reach_back_far_enough():
    settings = replace(SETTINGS, updates=8, shortest=8, longest=8, slowest=0.95, fastest=1.05, speed_error=0.3)
    flow, told = Oscillator(), list[float]()

    def watched(tasks: Sequence[Task]) -> list[Stretch]:
        told.extend(value for task in tasks for value in task.readings.told * task.speeds[:-1])
        return [differentiate(flow, task) for task in tasks]

    refine(feedback, flow, [START] * 2, settings, np.full(4, 0.1), seed=3, side_by_side=watched)
    assert (min(told), max(told)) == pytest.approx((0.95, 1.05))


def test_the_predictor_finds_a_linear_system_and_needs_stretches_longer_than_its_memory():
    """y_{k+1} = 0.9 y_k - 0.5 y_{k-1} + 2 a_k, driven at random: a memory of two rows holds all of it."""
    rng = np.random.default_rng(0)
    stretches = []
    for _ in range(3):
        y, actions = np.zeros(80), rng.normal(0.0, 0.1, 80)
        for k in range(1, 79):
            y[k + 1] = 0.9 * y[k] - 0.5 * y[k - 1] + 2.0 * actions[k]
        stretches.append(np.column_stack([y, actions]))
    np.testing.assert_allclose(predictor(stretches, 2), [[[-0.5, 0.0], [0.9, 2.0]]], atol=1e-4)
    # Rows of sqrt(ridge m) times the scale under the regressors give the same least squares.
    noisy = stretches[0] + rng.normal(0.0, 0.05, (80, 2))
    X, T = np.array([noisy[k - 2 : k + 1].ravel() for k in range(2, 79)]), noisy[3:, :1]
    padded = np.vstack([X, np.diag(np.sqrt(pipeline.PREDICTOR_RIDGE * (X**2).sum(axis=0)))])
    expected = np.linalg.lstsq(padded, np.vstack([T, np.zeros((6, 1))]), rcond=None)[0]
    np.testing.assert_allclose(predictor([noisy], 3).ravel(), expected.ravel(), rtol=1e-7)
    with pytest.raises(StillwakeError, match="3 control steps are too few to fit 12 coefficients"):
        predictor([noisy[:9]], 6)
    with pytest.raises(StillwakeError, match="column 1 is zero in all rows"):
        predictor([noisy * [1.0, 0.0]], 2)
    # What it reads are differences of mirror images.
    check_pairs(TRUCK, ("upper_39", "lower_39", "base_0", "base_9"))
    for layout, sensors, error, named in (
        (TRUCK, ("upper_39", "base_0"), DatasetError, "upper_39 and base_0 are not a pair: .* upper_39 is lower_39"),
        (TRUCK, ("upper_39", "lower_39", "base_0"), DatasetError, "3 sensors must be pairs"),
        (TRUCK, ("upper_39", "under"), ConfigError, "unknown sensor 'under'"),
        (replace(TRUCK, mirror=None), ("upper_39", "lower_39"), DatasetError, "have no mirror images"),
    ):
        with pytest.raises(error, match=named):
            check_pairs(layout, sensors)
    with pytest.raises(ConfigError, match=r"refine\.shortest = 60: must be more than refine.memory"):
        RefineConfig(shortest=60)


@each("prices", ({"lift_price": 1.001}, {"effort_price": 9.001}))
def test_a_price_that_the_training_would_not_use_is_refused(prices):
    highest = RefineConfig(lift_price=1.0, effort_price=9.0)
    check_prices(highest)
    assert _next_goal(highest, np.random.default_rng(0)).prices() == (9.0, 1.0)
    with pytest.raises(ConfigError, match=f"{min(prices)} = .* must be at most"):
        check_prices(RefineConfig(**prices))


def test_the_wake_without_jets_is_measured_over_the_range_and_at_the_design_speed():
    at = partial(resting_by_speed, Oscillator(), START, progress=silent)
    assert at(Config()) is None
    table = at(Config(refine=replace(SETTINGS, slowest=0.55, fastest=1.4)))
    assert table is not None and table[0].tolist() == pytest.approx([0.55, -0.275, 0.2 * 0.55**2])
    assert len(table) == pipeline.SPEEDS_AT_REST + 1 and 1.0 in table[:, 0] and (np.diff(table[:, 0]) > 0.0).all()
