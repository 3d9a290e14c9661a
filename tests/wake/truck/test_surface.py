"""Sensors and forces against pressure fields with a known integral (Gauss's theorem on the truck's outline)."""

import numpy as np
import pytest

from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from contract.geometry import HALF_WIDTH, JET_WIDTH, LENGTH
from wake.plant.sample import Sample
from wake.solver.grid import Flow
from wake.truck.surface import signed_distance
from wake.truck.truck_wake import TruckWake

BODY = BodyConfig(length=2.0, leading_edge_radius=0.5, sensors_per_side=3, sensors_on_base=1)


def _measure(wake: TruckWake, constant: float, slope_x: float = 0.0, slope_y: float = 0.0) -> Sample:
    """Measured quantities for a linear kinematic pressure.

    The velocity slope * distance^2 / (2 nu) rests on the wall, has no shear there, and balances the pressure gradient.
    """
    grid, flow = wake.grid, Flow.zeros(wake.grid.shape)
    flow.cells_p[:] = constant + slope_x * grid.xc[:, None] + slope_y * grid.yc
    balance = wake.config.reynolds / 2.0
    flow.faces_u[:] = balance * slope_x * signed_distance(grid.xf[:, None], grid.yc, wake.body) ** 2
    flow.faces_v[:] = balance * slope_y * signed_distance(grid.xc[:, None], grid.yf, wake.body) ** 2
    return wake.surface.measure(flow)


def test_pressures_have_their_known_integrals(shared_wake):
    """Of the truck, and of another body on a coarse grid."""
    other = TruckWake(FlowConfig(reynolds=100.0, substeps=50, refinement=0.7), body=BODY)
    for wake, Cp, along_x, along_y in ((shared_wake, 1e-7, 3e-4, 1e-4), (other, 5e-3, 5e-3, 3e-3)):
        measured = _measure(wake, 0.3, 0.1, -0.7)
        x, y = wake.layout.positions.T
        # What is left is the balancing velocity's square of the distance, interpolated linearly between rows.
        assert measured.Cp == pytest.approx(2 * (0.3 + 0.1 * x - 0.7 * y), abs=Cp)
        # Pressure gradients give archimedes force: -integral p n dS = -grad p * area, and a force coefficient is twice
        # the kinematic force. The balancing velocity is interpolated on the corners, and the slots' pressure is taken
        # half a cell before them.
        area = wake.body.length - 2 * (1 - np.pi / 4) * wake.body.leading_edge_radius**2
        along = _measure(wake, 0.0, 1.0, 0.0)
        assert along.Cd + along.Cd_slot_pressure == pytest.approx(-2 * area, rel=along_x)
        assert _measure(wake, 0.0, 0.0, 1.0).Cl == pytest.approx(-2 * area, rel=along_y)
    # Uniform pressure pushes only through the left out slots.
    measured = _measure(shared_wake, 1.0)
    slots = 2 * 2 * JET_WIDTH
    assert measured.Cd == pytest.approx(slots, abs=1e-4)  # the arc's quadrature
    assert measured.Cd_slot_pressure == pytest.approx(-slots, abs=1e-12)
    assert measured.Cd_slot_viscous == 0.0
    assert measured.Cl == pytest.approx(0.0, abs=1e-12)


def test_pressure_falls_towards_a_slot_as_the_flow_quickens(shared_wake):
    # Along x alone, momentum holds p + u^2 - 2 nu du/dx constant.
    grid, nu, at_face, slope, total = shared_wake.grid, 1.0 / shared_wake.config.reynolds, 1.5, -20.0, 0.4
    flow = Flow.zeros(grid.shape)
    flow.faces_u[:] = (at_face + slope * (grid.xf - LENGTH))[:, None]
    flow.cells_p[:] = (total - (at_face + slope * (grid.xc - LENGTH)) ** 2)[:, None]
    slots = shared_wake.surface.measure(flow)
    Cp = 2 * (total - at_face**2)
    assert shared_wake.surface.jet_pressures(flow) == pytest.approx((Cp, Cp), rel=1e-12)
    assert slots.Cd_slot_pressure == pytest.approx(-Cp * 2 * JET_WIDTH, rel=1e-12)
    # A normal stress of 2 nu du/dx on two slots; a force coefficient is twice the kinematic force.
    assert slots.Cd_slot_viscous == pytest.approx(2 * 2 * nu * slope * 2 * JET_WIDTH, rel=1e-9)


def test_wall_shear_of_a_known_layer(shared_wake):
    grid, nu = shared_wake.grid, 1.0 / shared_wake.config.reynolds
    flow = Flow.zeros(grid.shape)
    above = np.maximum(np.abs(grid.yc) - HALF_WIDTH, 0.0)
    flow.u[:, 1:-1] = (3.0 * above - above**2)[None, :]
    flow.u[: grid.front + 20] = 0.0  # only the straight sides count here
    measured = shared_wake.surface.measure(flow)
    length = LENGTH - grid.xf[grid.front + 20]
    assert measured.Cd == pytest.approx(2 * 2 * nu * 3.0 * length, rel=0.01)
