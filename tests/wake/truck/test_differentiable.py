"""The truck's wake as a training through it takes it: its slopes are those of differences of whole runs."""

from dataclasses import replace

import numpy as np
import pytest

from contract.config.plant import FlowConfig
from contract.differentiable import FlowState, Seen
from wake.truck.differentiable import DifferentiableWake
from wake.truck.truck_wake import TruckWake

SENSORS = ("upper_39", "lower_39", "base_0", "base_9")
ACTIONS = np.array([0.03, -0.02, 0.05, 0.01])


@pytest.mark.slow  # numba compiles the adjoint
def test_slopes_of_all_that_is_seen_are_those_of_differences():
    speeds = np.array([0.8, 0.85, 0.9, 1.0, 1.1])
    plant = TruckWake(FlowConfig(refinement=0.4, substeps=12))
    plant.advance(0.03)
    wake = DifferentiableWake(plant, plant.layout.indices(SENSORS))
    start, rng = FlowState(flat=plant.flow.flat.copy(), action=0.03), np.random.default_rng(0)
    weights = [Seen(Cp=rng.normal(size=4), Cd=rng.normal(), Cl=rng.normal(), Uy=rng.normal()) for _ in ACTIONS]

    def value(actions: np.ndarray) -> float:
        total = 0.0
        wake.begin(start, speeds)
        for action, weight in zip(actions, weights, strict=True):
            seen = wake.advance(float(action))
            total += float(weight.Cp @ seen.Cp)
            total += weight.Cd * seen.Cd + weight.Cl * seen.Cl + weight.Uy * seen.Uy
        return total

    value(ACTIONS)
    slopes = [wake.back(weight) for weight in reversed(weights)][::-1]
    for k, slope in enumerate(slopes):
        step = np.where(np.arange(len(ACTIONS)) == k, 1e-5, 0.0)
        # Differences of second order; the flow's own rounding is below that.
        assert slope == pytest.approx((value(ACTIONS + step) - value(ACTIONS - step)) / 2e-5, rel=1e-5)


@pytest.mark.slow
def test_a_wake_at_rest_at_another_speed_is_that_of_another_reynolds_number_in_other_units():
    config, speed = FlowConfig(refinement=0.4, substeps=12), 0.5
    plant = TruckWake(config)
    for action in (0.06, 0.06, 0.0):
        plant.advance(action)
    start = FlowState(flat=plant.flow.flat.copy())
    seen = DifferentiableWake(plant, plant.layout.indices(SENSORS)).at_rest(start, speed, over=1.0)
    slower = TruckWake(replace(config, reynolds=speed * config.reynolds, control_period=speed * config.control_period))
    slower.flow.flat[:] = start.flat
    Cp = np.array([slower.advance(0.0).Cp[slower.layout.indices(SENSORS)] for _ in range(20)])[10:]
    assert seen == pytest.approx((Cp[:, 2:].mean(), np.abs(Cp[:, ::2] - Cp[:, 1::2]).mean()), rel=1e-9)
    assert DifferentiableWake(plant, plant.layout.indices(("upper_39", "lower_39"))).at_rest(start, speed) is None
