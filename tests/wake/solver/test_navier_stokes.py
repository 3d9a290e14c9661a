"""The flow solver's orders of convergence: in space on an exact solution, in time on the developed wake with jets."""

import numpy as np
import pytest

from wake.solver import boundary
from wake.solver.grid import Grid
from wake.solver.navier_stokes import FlowSolver

pytestmark = pytest.mark.slow  # seconds of flow

RE = 40.0
DECAY = RE / 2 - np.sqrt(RE**2 / 4 + 4 * np.pi**2)


def _kovasznay_error(rows: int) -> float:
    """Largest error of u in the steady flow behind a row of bodies (Kovasznay, Proc. Camb. Phil. Soc. 44, 1948).

    The cell |y| <= 1/2 has slip sides in the exact solution too; the disturbance decays as exp(DECAY x) and is below
    the discretisation error at the outlet.
    """
    grid = Grid(xf=-0.5 + np.linspace(0.0, 7.5, 4 * rows + 1), yf=np.linspace(-0.5, 0.5, rows + 1))
    everywhere = boundary.Boundary(grid, lambda x, y: np.ones_like(np.asarray(x, dtype=float)))

    def exact_u(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 1 - np.exp(DECAY * x)[:, None] * np.cos(2 * np.pi * y)[None, :]

    inflow_v = DECAY / (2 * np.pi) * np.exp(DECAY * grid.xf[0]) * np.sin(2 * np.pi * grid.yf)
    solver = FlowSolver(grid, everywhere, 1 / RE, inflow_u=exact_u(grid.xf[:1], grid.yc)[0], inflow_v=inflow_v)
    flow = solver.start()
    dt = 0.3 / rows
    solver.run(flow, dt=dt, steps=round(15.0 / dt), action_from=0.0, action_to=0.0)
    inner = grid.xf < 3.0
    return float(np.abs(flow.faces_u - exact_u(grid.xf, grid.yc))[inner].max())


def test_second_order_in_space_on_the_kovasznay_flow():
    coarse, fine = _kovasznay_error(16), _kovasznay_error(32)
    assert fine < 0.02
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.3)


def test_velocity_is_of_second_order_in_time_and_pressure_of_first(coarse):
    results, orders = [], []
    for steps in (30, 60, 120):  # the plant takes 30 on the shipped grid
        with coarse.plant() as wake:
            # The jets go to 0.06 and on to -0.03, a period each.
            for start, end in ((0.0, 0.06), (0.06, -0.03)):
                wake.solver.run(wake.flow, dt=0.2 / steps, steps=steps, action_from=start, action_to=end)
            results.append((wake.flow.velocities.copy(), wake.flow.p.copy()))
    for quantity in (0, 1):
        few, middle, many = (result[quantity] for result in results)
        orders.append(np.log2(np.linalg.norm(few - middle) / np.linalg.norm(middle - many)))
    # Richardson: successive differences fall as the error does. Measured 1.99 and 1.02; the pressure is that of the
    # last projection, half a step old.
    assert orders[0] == pytest.approx(2.0, abs=0.1)
    assert orders[1] == pytest.approx(1.0, abs=0.1)
    # What the plant's own step leaves: far below the grid's error.
    assert np.abs(results[0][0] - results[2][0]).max() < 5e-3
