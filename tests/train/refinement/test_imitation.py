"""A prior that imitates others acts like them at their speeds, and as before at the design speed."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from contract.arrays import Array
from contract.controller.goal import Goal
from contract.differentiable import FlowState
from tests.train.refinement.oscillator import START, Oscillator, feedback_of
from train.refinement.feedback import Feedback
from train.refinement.imitation import PERIODS_AT_ONCE, SLOWEST, Demonstration, Watched, demonstration, imitate, watch
from train.refinement.windows import Stream, StretchReadings, closed_loop

MEMORY, PERIODS = 6, 110
GOAL = Goal(lift=0.2)


def course(speed: float) -> Array:
    return np.concatenate([np.linspace(1.0, speed, 41), np.full(PERIODS, speed)])


def watched(policy: Feedback, speed: float, told: float = 1.0, start: FlowState = START) -> Watched:
    speeds = course(speed)
    return watch(Oscillator(), policy, start, speeds, GOAL, told=np.full(len(speeds) - 1, told))


def demonstrated(policy: Feedback, speed: float, start: FlowState = START) -> Demonstration:
    run = watched(policy, speed, start=start)
    return demonstration(run, policy, GOAL, told=np.ones(len(run.rows)))


@pytest.mark.parametrize(("speed", "told"), [(0.8, 1.0), (0.8, 0.9), (1.3, 1.1)])
def test_a_demonstration_is_what_a_closed_loop_read_at_the_told_speed(speed: float, told: float):
    policy, speeds = feedback_of(seed=1), course(speed)
    run = watched(policy, speed, told)
    ratios = np.full(len(run.rows), told)
    assert len(run.rows) == len(speeds) - 1 > PERIODS_AT_ONCE
    stream = Stream.begun(START, policy, SLOWEST)
    stream.goal = GOAL
    readings = replace(StretchReadings.plain(len(ratios), policy.pairs), told=ratios)
    reads = list[tuple[torch.Tensor, float, Goal]]()
    hook = policy.register_forward_pre_hook(lambda _, given: reads.append(given))
    with torch.no_grad():
        loop = closed_loop(Oscillator(), policy, stream, readings, speeds)
    hook.remove()
    assert run.Cd.tolist() == pytest.approx([one.Cd for one in loop.seen[1:]], rel=1e-12)
    found = demonstration(run, policy, GOAL, told=ratios)
    first = len(ratios) - len(found.rows)
    assert first == 2 * MEMORY
    for k, (rows, at, _) in enumerate(reads[first:]):
        assert found.speeds[k] == pytest.approx(at)
        assert found.rows[k].numpy() == pytest.approx(rows.numpy(), abs=1e-12)
    # The action is the expert's at the true speed, as a prior that is told another speed has to command it.
    right = demonstration(run, policy, GOAL, told=np.ones(len(ratios)))
    before = run.rows[-1, -1]
    commands = [
        float(before + min(1.0, one.speeds[-1] ** 2) * (one.actions[-1] * one.speeds[-1] - before))
        for one in (found, right)
    ]
    assert commands[0] == pytest.approx(commands[1], rel=1e-12)
    with torch.no_grad():
        assert float(right.actions[-1]) == pytest.approx(float(policy(right.rows[-1], speed, GOAL)), rel=1e-9)


def test_a_prior_that_is_told_a_wrong_speed_acts_like_one_that_is_told_the_right_speed():
    student, expert = feedback_of(seed=1, units=8), feedback_of(seed=1, units=8)
    runs = [watched(expert, 1.4, start=FlowState(flat=np.array(flat))) for flat in ((0.3, -0.2), (-0.1, 0.5))]
    *given, unseen = [
        demonstration(run, expert, GOAL, told=np.full(len(run.rows), 0.9))
        for run in (*runs, watched(expert, 1.4, start=FlowState(flat=np.array((0.1, 0.3)))))
    ]
    apart = error_of(student, unseen)
    imitate(student, given, GOAL, faster=True)
    assert error_of(student, unseen) < 0.3 * apart


def test_a_prior_takes_over_other_priors_on_each_side_and_stays_the_same_at_the_design_speed():
    student, slow, fast = feedback_of(seed=1, units=8), feedback_of(seed=2), feedback_of(seed=3)
    before = feedback_of(seed=1, units=8)
    for expert, speed in ((slow, 0.7), (fast, 1.4)):
        given = [demonstrated(expert, speed, FlowState(flat=np.array(flat))) for flat in ((0.3, -0.2), (-0.1, 0.5))]
        unseen = demonstrated(expert, speed, FlowState(flat=np.array((0.1, 0.3))))
        apart = error_of(student, unseen)
        imitate(student, given, GOAL, faster=speed > 1.0)
        # Part of the difference remains: near the design speed, and because the units keep their weights of the sums.
        assert error_of(student, unseen) < 0.2 * apart, speed
    rows = demonstrated(student, 1.0).rows
    with torch.no_grad():
        assert [float(student(one, 1.0, GOAL)) for one in rows] == [float(before(one, 1.0, GOAL)) for one in rows]


def error_of(policy: Feedback, given: Demonstration) -> float:
    """Root mean square of the policy's action minus the demonstrated one."""
    with torch.no_grad():
        done = [float(policy(rows, at, GOAL)) for rows, at in zip(given.rows, given.speeds, strict=True)]
    return float(np.sqrt(np.mean((np.array(done) - given.actions.numpy()) ** 2)))
