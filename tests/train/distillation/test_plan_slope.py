"""The slope along a plan is that of the controller's reference, and falls where the cost falls."""

from dataclasses import replace

import numpy as np
import torch

from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from examples.random_programs import random_program
from export.program.controller_program import ControllerProgram
from export.program.weights import DecoderWeights, DynamicsWeights
from export.reference.mpc import gradient
from train.distillation.lessons import force_slope, plan_slope, predict
from train.networks.model import Predictor

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
    found = predict(predictor, torch.tensor(z), actions)
    by_force = force_slope(found.forces[1:], WEIGHTS, program.scaling)
    slope = plan_slope(found, actions, by_force)
    expected = gradient(program, z, plans, 0.0)
    # Float64 on both sides; the two differ in the order of sums.
    assert np.allclose(slope.numpy() / program.scaling.action_std, expected, rtol=1e-9, atol=1e-12)
    # Terms without weight have no slope.
    nothing = replace(WEIGHTS, drag_mean=0.0, drag_fluctuation=0.0, lift=0.0, lift_mean=0.0)
    assert not force_slope(torch.randn(HORIZON, 2, 2), nothing, program.scaling).any()


def test_the_slope_is_differentiable_by_the_weights():
    predictor, _ = _with_program()
    weight = predictor.dynamics.output.weight
    actions = torch.linspace(-1.0, 1.0, HORIZON, dtype=torch.float64)[None].requires_grad_(True)
    latent = torch.ones(1, 3, dtype=torch.float64)
    by_force = torch.ones(HORIZON, 1, 2, dtype=torch.float64)

    def first_slope(*, differentiable: bool) -> torch.Tensor:
        return plan_slope(predict(predictor, latent, actions), actions, by_force, differentiable=differentiable)[0, 0]

    (found,) = torch.autograd.grad(first_slope(differentiable=True), weight)
    step, values = 1e-6, []
    for moved in (step, -2.0 * step):
        with torch.no_grad():
            weight[0, 0] += moved
        values.append(first_slope(differentiable=False).item())
    # Central difference: its own error is near 1e-10 here.
    assert abs((values[0] - values[1]) / (2.0 * step) - found[0, 0].item()) < 1e-7
