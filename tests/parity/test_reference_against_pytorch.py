"""First link of the chain: NumPy reference = PyTorch autograd + torch.optim.Adam + clamp, both in float64.

Tolerance 1e-9: the two differ in rounding only (1e-16 a number, some 1e-14 after a roll-out with its adjoint),
and Adam divides by a gradient plus 1e-8, which can raise a rounding of 1e-16 to 1e-8 of the learning rate.
Random reals hit no kink of max, min or |Cl|; ties are tested on their own.
"""

from typing import Any

import numpy as np
import pytest
import torch

from benchmarks.controller.eager import EagerController
from contract.config.controller import MpcConfig
from examples.random_programs import random_program
from export.gates import control_cases
from export.reference.mpc import control_step, cost_gradient, gradient
from tests.each import each
from tests.parity.drawn import drawn_program

pytestmark = pytest.mark.slow  # seconds of whole control steps by autograd

TOLERANCE = 1e-9
torch.set_num_threads(1)


@each("seed", range(3))
def test_control_step_of_random_small_nets(seed):
    program = drawn_program(seed)
    for case in control_cases(program, count=3, seed=seed):
        expected: Any = EagerController(program, torch.float64).control_step(*case)
        found = control_step(program, *case)
        for name, value in zip(("plan", "forces", "terms", "cost"), expected, strict=True):
            np.testing.assert_allclose(getattr(found, name), value, rtol=0, atol=TOLERANCE, err_msg=name)


@each("seed", range(10))
def test_gradient_matches_autograd(seed):
    program = drawn_program(seed)
    rng = np.random.default_rng(seed)
    h = program.mpc.horizon
    z, plan = rng.normal(size=program.latent), rng.uniform(-0.1, 0.1, h)
    weights, start = rng.uniform(0.1, 2.0, 8), rng.uniform(-0.1, 0.1, h)
    eager = EagerController(program, torch.float64)
    actions, previous = torch.tensor(plan, requires_grad=True), torch.tensor(0.03, dtype=torch.float64)
    terms = eager.terms(eager.predict(torch.tensor(z), actions), actions, previous, torch.tensor(start))
    (expected,) = torch.autograd.grad(torch.tensor(weights) @ terms, actions)
    found = gradient(program, z, plan, 0.03, weights, start)
    np.testing.assert_allclose(found, expected.numpy(), rtol=1e-11, atol=1e-13)


def test_ties_and_kinks_take_pytorchs_subgradients():
    program = random_program(0, mpc=MpcConfig(horizon=5))
    forces = np.array([[1.0, 0.0], [2.0, 0.5], [2.0, -0.5], [1.0, 0.0], [1.0, 0.3]])
    plan, weights = np.zeros(5), np.arange(1.0, 9.0)
    values, actions = torch.tensor(forces, requires_grad=True), torch.tensor(plan, requires_grad=True)
    terms = EagerController(program, torch.float64).terms(values, actions, torch.tensor(0.01, dtype=torch.float64))
    torch.autograd.backward(torch.tensor(weights) @ terms)
    for found, expected in zip(cost_gradient(forces, plan, 0.01, weights), (values, actions), strict=True):
        assert expected.grad is not None
        np.testing.assert_allclose(found, expected.grad.numpy(), rtol=0, atol=1e-14)
