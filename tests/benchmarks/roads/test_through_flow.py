"""The policy's gradient is that of the plant and the policy together; mirrored histories get mirrored actions."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from benchmarks.roads.loop import MIRROR_SENSORS
from benchmarks.roads.through_flow import MEMORY, Policy, Stream, Windows
from contract.config.plant import FlowConfig
from wake.truck.truck_wake import TruckWake

PERIODS, PRICE = 12, 0.06


@pytest.fixture
def policy() -> Policy:
    made = Policy(0.075)
    torch.nn.init.normal_(made.second, 0.0, 0.3, generator=torch.Generator().manual_seed(1))
    return made


def test_a_mirrored_wake_gets_the_mirrored_action(policy):
    window = np.random.default_rng(0).normal(-0.3, 0.1, (MEMORY, 5))
    mirrored = np.column_stack([window[:, [1, 0, 3, 2]], -window[:, 4]])
    action = policy.law(window, 0.02)
    assert 0.0 < abs(action) < 0.075
    assert policy.law(mirrored, -0.02) == pytest.approx(-action, rel=1e-12)


@pytest.mark.slow  # numba compiles the adjoint
def test_the_gradient_is_that_of_plant_and_policy(policy):
    plant = TruckWake(FlowConfig(refinement=0.4, substeps=12))
    windows = Windows(plant, policy, plant.layout.indices(MIRROR_SENSORS), PRICE)
    # Flow at rest with a pressure of its own: it moves at once, and nothing in it is symmetric for long.
    plant.advance(0.03)
    start = replace(plant.state(), substep=0)

    def cost() -> float:
        window, committed, costs = np.zeros((MEMORY, 5)), 0.0, []
        plant.reset(start)
        sample, before = plant.sample(), 0.0
        for _ in range(PERIODS):
            window = np.vstack([window[1:], np.append(sample.Cp[plant.layout.indices(MIRROR_SENSORS)], before)])
            command = policy.law(window, committed)
            sample, before, committed = plant.advance(committed), committed, command
            costs.append(sample.Cd + PRICE * sample.Cl**2)
        return float(np.mean(costs))

    windows.gradient(Stream(state=start, history=np.zeros((MEMORY, 3))), PERIODS)
    for weights, index in ((policy.second, (3,)), (policy.first, (2, 5)), (policy.first, (20, 7))):
        assert weights.grad is not None
        costs = []
        for step in (1e-4, -2e-4):
            with torch.no_grad():
                weights[index] += step
            costs.append(cost())
        with torch.no_grad():
            weights[index] += 1e-4
        # Differences of second order; the flow's own rounding is below that.
        assert float(weights.grad[index]) == pytest.approx((costs[0] - costs[1]) / 2e-4, rel=1e-4)
