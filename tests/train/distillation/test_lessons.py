"""Lessons hold the teacher's own answers, and half of their plans go down its cost.

The slope along a plan is that of the controller's reference, and falls where the cost falls.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from contract.config.tree import Config
from contract.release.manifest import Scaling
from examples.random_programs import random_program
from export.program.controller_program import ControllerProgram
from export.program.weights import DecoderWeights, DynamicsWeights
from export.reference.mpc import cost_terms, gradient
from train.distillation.distil import encode_all
from train.distillation.lessons import Lessons, force_slope, plan_slope, predict, teach
from train.networks.model import Predictor, WakeModel
from train.networks.samples import Rows, fit_scaling, prepare


@pytest.fixture(scope="module")
def taught(small_recording, small_config) -> tuple[WakeModel, Rows, Scaling, Config, Lessons]:
    episodes = small_recording.episodes[:1]
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
    forces = lessons.forces[:, 1:].numpy() * scaling.force_std + scaling.force_mean
    cost = cost_terms(forces, 0.0 * forces[..., 0], 0.0, 0.0) @ config.mpc.weights.as_tuple()
    # Batches take turns: a plan's step, then lessons of recorded actions.
    way = cost[: len(cost) // 32 * 32].reshape(-1, 2, 256)[:16, 0].mean(1)
    assert way[-1] < way[0]
    assert lessons.actions.abs().max() * scaling.action_std <= config.flow.action_limit * (1.0 + 1e-6)


MODEL = ModelConfig(dynamics_width=12, decoder_width=10, latent=3, dropout=0.0)
# The terms in the plan alone are no part of what networks are taught.
WEIGHTS = CostWeights(lift=0.2, lift_mean=0.7, smoothness=0.0)
HORIZON = 9


def _with_program() -> tuple[Predictor, ControllerProgram]:
    program = random_program(3, model=MODEL, mpc=MpcConfig(horizon=HORIZON, weights=WEIGHTS))
    torch.manual_seed(0)
    predictor = Predictor(MODEL).double()
    dynamics, decoder = (
        {name: value.numpy() for name, value in part.state_dict().items()}
        for part in (predictor.dynamics, predictor.decoder)
    )
    return predictor, replace(
        program, dynamics=DynamicsWeights.from_state(dynamics), decoder=DecoderWeights.from_state(decoder)
    )


def test_the_slope_is_the_reference_adjoints():
    predictor, program = _with_program()
    generator = np.random.default_rng(1)
    z = generator.standard_normal((4, 3))
    plans = generator.uniform(-0.07, 0.07, (4, HORIZON))
    actions = torch.tensor(plans / program.scaling.action_std).requires_grad_(True)
    _, forces = predict(predictor, torch.tensor(z), actions)
    slope = plan_slope(forces, actions, force_slope(forces[1:], WEIGHTS, program.scaling))
    expected = gradient(program, z, plans, 0.0)
    # Float64 on both sides; the two differ in the order of sums.
    assert np.allclose(slope.numpy() / program.scaling.action_std, expected, rtol=1e-9, atol=1e-12)


def test_the_slope_is_differentiable_by_the_weights():
    predictor, _ = _with_program()
    weight = predictor.dynamics.output.weight
    actions = torch.linspace(-1.0, 1.0, HORIZON, dtype=torch.float64)[None].requires_grad_(True)
    latent = torch.ones(1, 3, dtype=torch.float64)
    by_force = torch.ones(HORIZON, 1, 2, dtype=torch.float64)

    def first_slope(*, differentiable: bool) -> torch.Tensor:
        _, forces = predict(predictor, latent, actions)
        return plan_slope(forces, actions, by_force, differentiable=differentiable)[0, 0]

    (found,) = torch.autograd.grad(first_slope(differentiable=True), weight)
    step, values = 1e-6, []
    for moved in (step, -2.0 * step):
        with torch.no_grad():
            weight[0, 0] += moved
        values.append(first_slope(differentiable=False).item())
    # Central difference: its own error is near 1e-10 here.
    assert abs((values[0] - values[1]) / (2.0 * step) - found[0, 0].item()) < 1e-7
