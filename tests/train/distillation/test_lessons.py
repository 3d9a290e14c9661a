"""Lessons hold the teacher's own answers, and half of their plans go down its cost."""

from dataclasses import replace

import pytest
import torch

from contract.config.tree import Config
from contract.release.manifest import Scaling
from train.distillation.distil import encode_all
from train.distillation.lessons import Lessons, teach
from train.networks.model import WakeModel
from train.samples.rows import Rows, fit_scaling, prepare


@pytest.fixture(scope="module")
def taught(make_episode, small_config) -> tuple[WakeModel, Rows, Scaling, Config, Lessons]:
    episodes = (make_episode("a", "train", 300, 1),)
    scaling = fit_scaling(episodes)
    rows = prepare(episodes, scaling, mirrored=True)
    config = replace(
        small_config,
        train=replace(small_config.train, predictor_lessons=1000),
        mpc=replace(small_config.mpc, horizon=6),
    )
    torch.manual_seed(0)
    teacher = WakeModel(rows.sensors, config.model).eval()
    return teacher, rows, scaling, config, teach(teacher, encode_all(teacher.encoder, rows), rows, scaling, config)


def test_lessons_are_the_teachers_and_their_plans_go_down_its_cost(taught):
    teacher, _, scaling, config, lessons = taught
    assert len(lessons) >= 1000
    some = lessons.drawn(torch.tensor([0, 17, 999]))
    with torch.no_grad():
        ahead = teacher.dynamics.rollout(some.latents[:, 0], some.actions).transpose(0, 1)
        assert torch.allclose(some.latents[:, 1:], ahead, atol=1e-5)  # float32, in other batches
        assert torch.allclose(some.forces, teacher.decoder(some.latents), atol=1e-5)
    # Plans on their way cost less step by step and stay within the limit.
    weights = config.mpc.weights
    drag, lift = (lessons.forces[:, 1:] * torch.tensor(scaling.force_std) + torch.tensor(scaling.force_mean)).unbind(-1)
    cost = (
        weights.drag_mean * drag.mean(1)
        + weights.drag_fluctuation * (drag.amax(1) - drag.amin(1))
        + weights.lift * lift.abs().mean(1)
        + weights.lift_mean * lift.mean(1).square()
    )
    # Batches take turns: a plan's step, then lessons of recorded actions.
    way = cost[: len(cost) // 32 * 32].reshape(-1, 2, 256)[:16, 0].mean(1)
    assert way[-1] < way[0]
    assert lessons.actions.abs().max() * scaling.action_std <= config.flow.action_limit * (1.0 + 1e-6)


def test_the_same_seed_gives_the_same_lessons(taught):
    teacher, rows, scaling, config, lessons = taught
    latents = encode_all(teacher.encoder, rows)
    assert torch.equal(teach(teacher, latents, rows, scaling, config).slope, lessons.slope)
    other = replace(config, train=replace(config.train, seed=config.train.seed + 1))
    assert not torch.equal(teach(teacher, latents, rows, scaling, other).actions, lessons.actions)
