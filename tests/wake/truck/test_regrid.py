"""A developed wake moved to another grid."""

import numpy as np
import pytest

from contract.config.plant import FlowConfig
from contract.errors import ConfigError
from wake.plant.sample import Sample
from wake.solver.flow import Flow
from wake.solver.grid import truck_grid
from wake.truck.averages import over_cycles
from wake.truck.develop import interpolated, moved
from wake.truck.state import State, developed_state
from wake.truck.truck_wake import TruckWake

COARSE = FlowConfig(refinement=0.4, substeps=12)


def test_a_linear_flow_is_interpolated_exactly():
    fine, coarse = truck_grid(), truck_grid(0.4)

    def linear(grid):
        flow = Flow.zeros(grid.shape)
        for name, values in (("u", flow.faces_u), ("v", flow.faces_v), ("p", flow.cells_p)):
            x, y = np.meshgrid(*grid.axes(name), indexing="ij")
            values[:] = 0.3 + 0.07 * x - 0.11 * y
        return flow

    found = interpolated(State(flat=linear(fine).flat, substep=0, action=0.0), fine, coarse)
    # Also beyond the outermost points of the fine grid, in double precision over some 30 W.
    assert np.abs(found.flat - linear(coarse).flat).max() < 1e-12
    # A grid too coarse for the slots is refused with what would do.
    with pytest.raises(ConfigError, match=r"refinement = 0\.35: gives 1 cells a slot, .* take 0\.38 or more"):
        TruckWake(FlowConfig(refinement=0.35))
    assert truck_grid(0.38).slot_cells == 2


@pytest.mark.slow  # 25 t_c of the wake
def test_the_wake_goes_on_shedding_on_the_coarse_grid():
    wake = TruckWake(COARSE)
    told: list[tuple[float, float]] = []
    state = moved(developed_state(), truck_grid(), wake, 10.0, lambda t, total: told.append((t, total)))
    assert (wake.t, state.substep, state.action) == (0.0, 0, 0.0)
    assert len(told) == 50 and told[-1] == pytest.approx((10.0, 10.0))
    samples, inside, transverse = list[Sample](), int(np.searchsorted(wake.grid.xc, 22.0)), []
    for _ in range(75):
        samples.append(wake.advance(0.0))
        transverse.append(np.abs(wake.flow.faces_v[[inside, -1]]).max(axis=1))
    cycles = over_cycles(np.array([s.t for s in samples]), np.array([s.Cl for s in samples]))
    # The default grid sheds at 0.1994; a wake that fell back to the steady flow would have no cycle here.
    assert cycles.frequency == pytest.approx(0.1994, abs=0.01)
    # OpenFOAM on two meshes: 0.97 and 1.10.
    assert 0.9 < cycles.std([s.Cl for s in samples]) < 1.2
    # Vortices leave: an outlet whose velocity is copied from upstream allows no transverse flow there.
    upstream, last = np.array(transverse)[:25].max(axis=0)
    assert upstream > 0.1 and last > 0.5 * upstream
    assert np.abs(wake.solver.divergence(wake.flow)).max() < 1e-9
