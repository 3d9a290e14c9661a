"""The flow solver against an exact solution of the Navier-Stokes equations, and its conservation on the truck."""

import numpy as np
import pytest

from contract.errors import PlantError
from wake.solver import boundary
from wake.solver.grid import from_faces
from wake.solver.navier_stokes import FlowSolver
from wake.truck.body import signed_distance
from wake.truck.truck_wake import TruckWake

pytestmark = pytest.mark.slow  # seconds of flow

RE = 40.0
DECAY = RE / 2 - np.sqrt(RE**2 / 4 + 4 * np.pi**2)


def _kovasznay_error(rows: int) -> float:
    """Largest error of u in the steady flow behind a row of bodies (Kovasznay, Proc. Camb. Phil. Soc. 44, 1948).

    The cell |y| <= 1/2 has slip sides in the exact solution too; the disturbance decays as exp(DECAY x) and is below
    the discretisation error at the outlet.
    """
    grid = from_faces(-0.5 + np.linspace(0.0, 7.5, 4 * rows + 1), np.linspace(-0.5, 0.5, rows + 1))
    everywhere = boundary.build(grid, lambda x, y: np.ones_like(np.asarray(x, dtype=float)))

    def exact_u(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 1 - np.exp(DECAY * x)[:, None] * np.cos(2 * np.pi * y)[None, :]

    inflow_v = DECAY / (2 * np.pi) * np.exp(DECAY * grid.xf[0]) * np.sin(2 * np.pi * grid.yf)
    solver = FlowSolver(grid, everywhere, 1 / RE, inflow_u=exact_u(grid.xf[:1], grid.yc)[0], inflow_v=inflow_v)
    flow = solver.start()
    dt = 0.3 / rows
    solver.run(flow, dt=dt, steps=round(25.0 / dt), action_from=0.0, action_to=0.0)
    inner = grid.xf < 3.0
    return float(np.abs(flow.faces_u - exact_u(grid.xf, grid.yc))[inner].max())


def test_second_order_in_space_on_the_kovasznay_flow() -> None:
    coarse, fine = _kovasznay_error(16), _kovasznay_error(32)
    assert fine < 0.02
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.3)


def test_divergence_is_round_off_at_full_amplitude(wake: TruckWake) -> None:
    wake.advance(0.075)
    wake.advance(-0.075)
    # Velocities of order 1 over cells of order 0.01 leave 1e-14 of rounding a term.
    assert np.abs(wake.solver.divergence(wake.flow)).max() < 1e-10


def test_jets_add_no_net_mass(wake: TruckWake) -> None:
    wake.advance(0.06)
    base = wake.flow.u[wake.grid.rear, 1:-1] * wake.grid.dy
    slots = base[wake.grid.lower : wake.grid.upper]
    assert slots[slots > 0].sum() == pytest.approx(0.06, rel=1e-12)
    # Face by face, so that no order of summation can leave a residue.
    assert np.array_equal(slots, -slots[::-1])


def test_what_flows_in_flows_out(wake: TruckWake) -> None:
    wake.advance(0.05)
    inflow = (wake.flow.u[0, 1:-1] * wake.grid.dy).sum()
    outflow = (wake.flow.u[-2, 1:-1] * wake.grid.dy).sum()
    assert outflow == pytest.approx(inflow, rel=1e-11)


def test_a_symmetric_start_stays_symmetric(shared_wake: TruckWake) -> None:
    flow = shared_wake.solver.start()
    shared_wake.solver.run(flow, dt=1e-4, steps=100, action_from=0.0, action_to=0.0)
    shared_wake.solver.run(flow, dt=1e-3, steps=500, action_from=0.0, action_to=0.0)
    assert np.abs(flow.u - flow.u[:, ::-1]).max() < 1e-12
    assert np.abs(flow.v + flow.v[:, ::-1]).max() < 1e-12


def test_mirrored_flow_and_action_give_the_mirrored_future(wake: TruckWake) -> None:
    first = wake.advance(0.04)
    state = wake.state()
    straight = wake.advance(-0.03)
    wake.reset(state)
    flow = wake.flow
    u, v, p = flow.u[:, ::-1].copy(), -flow.v[:, ::-1], flow.p[:, ::-1].copy()
    flow.u[:], flow.v[:], flow.p[:] = u, v, p
    mirrored = wake.reset(type(state)(flat=flow.flat.copy(), substep=state.substep, action=-first.action))
    mirrored = wake.advance(0.03)
    # Not to the bit: sums over j run the other way round. Growth over one period is mild.
    assert mirrored.Cl == pytest.approx(-straight.Cl, abs=1e-9)
    assert mirrored.Cd == pytest.approx(straight.Cd, abs=1e-9)


def test_too_long_a_step_is_an_error_not_a_number(wake: TruckWake) -> None:
    with pytest.raises(PlantError, match="diverged"):
        wake.solver.run(wake.flow, dt=0.05, steps=200, action_from=0.0, action_to=0.0)


def test_body_distance_is_exact_on_the_arc() -> None:
    angle = np.linspace(0.5 * np.pi, np.pi, 20)
    x, y = 0.118 * (1 + np.cos(angle)), 0.5 - 0.118 * (1 - np.sin(angle))
    assert np.abs(signed_distance(x, y)).max() < 1e-12
