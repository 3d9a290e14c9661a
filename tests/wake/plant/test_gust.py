"""Wind that varies, and a viscosity that changes, while the wake runs."""

from collections.abc import Iterator
from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest
from scipy.integrate import quad

from contract.config.plant import FlowConfig
from contract.errors import PlantError
from wake.plant.drive import Gust, Wind
from wake.solver import boundary
from wake.solver.flow import Flow
from wake.solver.grid import from_faces
from wake.solver.navier_stokes import FlowSolver
from wake.truck.state import developed_state
from wake.truck.truck_wake import TruckWake


def test_a_gust_is_a_sine_of_whole_cycles_about_the_mean():
    gust = Gust(amplitude=0.2, period=4.0, start=3.0, cycles=2)
    assert gust(4.0) == pytest.approx(0.2)
    assert gust(6.0) == pytest.approx(-0.2)
    assert [gust(t) for t in (0.0, 2.999, 11.001, 50.0)] == [0.0] * 4
    # An integral of two cycles of a sine, and it begins and ends without a jump.
    assert quad(gust, 3.0, 11.0)[0] == pytest.approx(0.0, abs=1e-9)
    assert abs(gust(3.0)) + abs(gust(11.0)) < 1e-12
    assert Gust(amplitude=0.2, period=4.0, cycles=inf)(4001.0) == pytest.approx(0.2)


def uniform(wind: Wind | None, time: float, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """u, v and p in a stream without a body, after a time."""
    grid = from_faces(np.linspace(-1.0, 5.0, 25), np.linspace(-1.0, 1.0, 13))
    everywhere = boundary.build(grid, lambda x, y: np.ones_like(np.asarray(x, dtype=float)))
    solver = FlowSolver(grid, everywhere, 1 / 500)
    flow = Flow.zeros(grid.shape)
    flow.u[:] = 1.0
    solver.run(flow, dt=dt, steps=round(time / dt), action_from=0.0, action_to=0.0, wind=wind)
    return flow.faces_u, flow.faces_v, flow.cells_p


@pytest.mark.parametrize("time", [0.13, 0.25, 0.8])
def test_a_stream_without_a_body_is_the_wind_everywhere_and_at_rest_with_its_pressure(time):
    """du/dt = dU/dt and grad p = 0, the equation of motion in the frame of a body that moves through still air."""
    gust = Gust(amplitude=0.3, period=1.0)
    u, v, p = uniform(gust, time, dt=0.01)
    # A hundred additions of numbers of order 1.
    np.testing.assert_allclose(u, 1.0 + 0.3 * np.sin(2 * pi * time), rtol=0, atol=1e-13)
    assert np.abs(v).max() < 1e-13
    # The projection divides what is left of rounding by the time step.
    assert np.abs(p).max() < 1e-10


@pytest.fixture
def developed(shared_wake) -> Iterator[TruckWake]:
    shared_wake.reset(developed_state())
    yield shared_wake
    shared_wake.wind = None
    if shared_wake.config.reynolds != FlowConfig().reynolds:
        shared_wake.set_reynolds(FlowConfig().reynolds)


@pytest.mark.slow  # builds a second plant
def test_a_changed_viscosity_is_that_of_a_plant_built_with_it(developed):
    built = TruckWake(replace(developed.config, reynolds=700.0))
    expected = built.reset(replace(developed_state(), origin=None))
    developed.set_reynolds(700.0)
    for _ in range(2):
        found = developed.sample()
        assert (found.Cd, found.Cl) == (expected.Cd, expected.Cl)
        np.testing.assert_array_equal(found.Cp, expected.Cp)
        expected, _ = built.advance(0.03), developed.advance(0.03)
    assert developed.state().origin == built.state().origin
    with pytest.raises(PlantError, match="reynolds"):
        developed.reset(developed_state())


def test_a_viscosity_whose_time_step_diverges_is_refused_and_nothing_changes(developed):
    with pytest.raises(PlantError, match="viscous number"):
        developed.set_reynolds(0.5)
    assert developed.config.reynolds == FlowConfig().reynolds
