"""The steady symmetric wake on a coarse grid."""

from dataclasses import replace

import numpy as np
import pytest

from contract.config.plant import FlowConfig
from contract.errors import PlantError
from wake.truck import steady
from wake.truck.truck_wake import TruckWake

pytestmark = pytest.mark.slow  # the flow settles


@pytest.fixture(scope="module")
def coarse() -> TruckWake:
    return TruckWake(FlowConfig(substeps=8, refinement=0.4))


@pytest.fixture(scope="module")
def settled(coarse) -> steady.SteadyWake:
    return steady.settle(coarse, tolerance=3e-3)


@pytest.fixture
def plant(coarse, settled) -> TruckWake:
    coarse.reset(settled.state)
    return coarse


def test_it_is_steady_and_symmetric_without_a_third_of_the_drag(plant, settled):
    u, v, p = plant.flow.u, plant.flow.v, plant.flow.p
    assert np.array_equal(u, u[:, ::-1])
    assert np.array_equal(v, -v[:, ::-1])
    assert np.array_equal(p, p[:, ::-1])
    # Five more periods, a unit of time, without taking the even part; rates only fall.
    for _ in range(5):
        later = plant.advance(0.0)
    assert abs(later.Cd + later.Cd_slot - settled.sample.Cd - settled.sample.Cd_slot) < 3e-3
    velocities = plant.flow.u.size + plant.flow.v.size
    assert np.abs(plant.flow.flat - settled.state.flat)[:velocities].max() < 3e-3
    # Without shedding a third of the drag is gone.
    # The shedding wake has 1.0 to 1.08 on every grid and in OpenFOAM, a base Cp of -0.44 to -0.49.
    assert 0.55 < settled.sample.Cd < 0.75
    assert -0.25 < settled.figures()["base_Cp"] < -0.1
    assert settled.recirculation_length > 4.0
    assert settled.sample.Cl == pytest.approx(0.0, abs=1e-9)


def test_what_is_not_steady_is_refused(plant, settled, coarse):
    with pytest.raises(
        PlantError, match=r"with an action of 0\.01 in force: `stillwake develop FILE --steady` computes"
    ):
        steady.check_steady(plant, replace(settled.state, action=0.01))
    plant.reset(settled.state)
    plant.advance(0.01)
    with pytest.raises(PlantError, match="velocities differ from their mirror image by up to"):
        steady.check_steady(plant, replace(plant.state(), substep=0, action=0.0))
    # Symmetric, and far from any balance.
    plant.reset(settled.state)
    plant.flow.u[:] *= 0.5
    with pytest.raises(PlantError, match=r"max \|du/dt\| = .*, must be at most 0\.01"):
        steady.check_steady(plant, replace(plant.state(), action=0.0))
    with pytest.raises(PlantError, match=r"not steady after 0\.4 t_c: max \|du/dt\| = .* must be below 1e-09"):
        steady.settle(coarse, tolerance=1e-9, longest=0.4)
