"""A square cylinder and other boxes in the same solver, and the truck's plant as it was before there were others."""

import dataclasses

import numpy as np
import pytest

from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from contract.errors import PlantError
from wake.truck.state import developed_state, load_state, save_state
from wake.truck.truck_wake import TruckWake

SQUARE = BodyConfig(length=1.0, leading_edge_radius=0.0, sensors_per_side=6, sensors_on_base=4)


@pytest.fixture(scope="module")
def square_plant() -> TruckWake:
    return TruckWake(FlowConfig(reynolds=100.0, substeps=12, refinement=0.4), body=SQUARE)


@pytest.fixture
def square(square_plant) -> TruckWake:
    """At rest in uniform flow."""
    square_plant.reset(dataclasses.replace(square_plant.state(), flat=square_plant.solver.start().flat, substep=0))
    return square_plant


def test_the_trucks_first_steps_are_those_from_before_other_bodies(wake):
    for action in (0.02, 0.07, -0.05):
        sample = wake.advance(action)
    # The last bit depends on the processor's linear algebra.
    assert sample.Cd == pytest.approx(0.9973759647024201, rel=1e-12)
    assert sample.Cl == pytest.approx(2.106641897948373, rel=1e-12)
    assert sample.Uy_probe == pytest.approx(-0.5623716000360626, rel=1e-12)


def test_a_symmetric_flow_stays_symmetric_but_for_rounding(square):
    square.solver.run(square.flow, dt=1e-3, steps=50, action_from=0.0, action_to=0.0)
    sample = square.advance(0.0)
    u, v, p = square.flow.u, square.flow.v, square.flow.p
    assert np.abs(u - u[:, ::-1]).max() < 1e-12
    assert np.abs(v + v[:, ::-1]).max() < 1e-12
    assert np.abs(p - p[:, ::-1]).max() < 1e-11
    assert square.layout.mirror is not None
    assert sample.Cp == pytest.approx(sample.Cp[square.layout.mirror], abs=1e-12)
    assert sample.Cl == pytest.approx(0.0, abs=1e-12)


def test_a_state_of_another_body_is_refused_by_name(square, wake, tmp_path):
    with pytest.raises(
        PlantError, match=r"body of length 7\.647 and leading-edge radius 0\.118, this plant has 1 and 0"
    ):
        square.reset(developed_state())
    save_state(tmp_path / "square.npz", square.state())
    loaded = load_state(tmp_path / "square.npz")
    assert loaded.origin is not None and loaded.origin.is_of(SQUARE)
    with pytest.raises(PlantError, match="of a body of length 1 and leading-edge radius 0"):
        wake.reset(loaded)
    square.reset(loaded)
