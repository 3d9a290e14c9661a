"""A developed wake moved to another grid, and the steady symmetric wake on a coarse grid."""

from dataclasses import replace

import numpy as np
import pytest

from contract.config.plant import FlowConfig
from contract.errors import ConfigError, PlantError
from wake.plant.sample import Sample
from wake.solver.grid import Flow, truck_grid
from wake.truck import develop
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
    with pytest.raises(ConfigError, match=r"refinement = 0\.35: a slot has 1 cells, .* take 0\.38 or more"):
        TruckWake(FlowConfig(refinement=0.35))
    assert truck_grid(0.38).slot_cells == 2


@pytest.mark.slow  # 4 t_c in small steps
def test_a_start_from_rest_takes_no_longer_steps_than_the_plant():
    """At Re = 8 viscosity allows less than half of the start's longest step."""
    wake = TruckWake(FlowConfig(reynolds=8.0, refinement=0.4, substeps=110))
    develop.start_from_rest(wake)
    assert wake.t == 0.0 and 5.0 < wake.sample().Cd < 10.0


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


@pytest.fixture(scope="module")
def settled() -> tuple[TruckWake, State, dict[str, float]]:
    plant = TruckWake(FlowConfig(substeps=8, refinement=0.4))
    return plant, *develop.settle(plant, tolerance=3e-3)


@pytest.mark.slow  # the flow settles
def test_it_is_steady_and_symmetric_without_a_third_of_the_drag(settled):
    plant, state, figures = settled
    plant.reset(state)
    assert plant.sample().Cl == pytest.approx(0.0, abs=1e-9)
    u, v, p = plant.flow.u, plant.flow.v, plant.flow.p
    assert np.array_equal(u, u[:, ::-1])
    assert np.array_equal(v, -v[:, ::-1])
    assert np.array_equal(p, p[:, ::-1])
    # Five more periods, a unit of time, without taking the even part; rates only fall.
    for _ in range(5):
        later = plant.advance(0.0)
    assert abs(later.Cd + later.Cd_slot - figures["Cd"] - figures["Cd_slot"]) < 3e-3
    velocities = plant.flow.u.size + plant.flow.v.size
    assert np.abs(plant.flow.flat - state.flat)[:velocities].max() < 3e-3
    # Without shedding a third of the drag is gone.
    # The shedding wake has 1.0 to 1.08 on every grid and in OpenFOAM, a base Cp of -0.44 to -0.49.
    assert 0.55 < figures["Cd"] < 0.75
    assert -0.25 < figures["base_Cp"] < -0.1
    assert figures["recirculation_length"] > 4.0


@pytest.mark.slow
def test_what_is_not_steady_is_refused(settled):
    plant, state, _ = settled
    with pytest.raises(
        PlantError, match=r"with an action of 0\.01 in force: `stillwake develop FILE --steady` computes"
    ):
        develop.check_steady(plant, replace(state, action=0.01))
    plant.reset(state)
    plant.advance(0.01)
    with pytest.raises(PlantError, match="velocities differ from their mirror image by up to"):
        develop.check_steady(plant, replace(plant.state(), substep=0, action=0.0))
    # Symmetric, and far from any balance.
    plant.reset(state)
    plant.flow.u[:] *= 0.5
    with pytest.raises(PlantError, match=r"max \|du/dt\| = .*, must be at most 0\.01"):
        develop.check_steady(plant, replace(plant.state(), action=0.0))
    with pytest.raises(PlantError, match=r"not steady after 0\.4 t_c: max \|du/dt\| = .* must be below 1e-09"):
        develop.settle(plant, tolerance=1e-9, longest=0.4)
