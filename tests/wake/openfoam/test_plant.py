"""The plant with icoFoam itself, on a coarse mesh and for a few control periods."""

import re
import shutil
from dataclasses import replace
from math import cos, pi

import numpy as np
import pytest

from contract.config.plant import FlowConfig, OpenFoamConfig
from contract.errors import PlantError
from wake.openfoam.plant import OpenFoamWake
from wake.openfoam.state import FoamState, developed
from wake.plant.sample import Sample
from wake.truck.state import developed_state
from wake.truck.truck_wake import TruckWake

pytestmark = [
    pytest.mark.openfoam,
    pytest.mark.skipif(shutil.which("icoFoam") is None, reason="needs icoFoam (Debian package openfoam)"),
]

CONFIG = FlowConfig(substeps=20)
FOAM = OpenFoamConfig(refinement=0.5, develop_time=0.6)


@pytest.fixture(scope="module")
def start(tmp_path_factory) -> FoamState:
    folder = tmp_path_factory.mktemp("start")
    seen: list[float] = []
    first = developed(folder, CONFIG, FOAM, lambda t, total: seen.append(t))
    assert seen[-1] == FOAM.develop_time
    assert [item.name for item in folder.iterdir()] == ["developed.npz"]
    began = (folder / "developed.npz").stat().st_mtime_ns
    assert developed(folder, CONFIG, FOAM).files == first.files
    assert (folder / "developed.npz").stat().st_mtime_ns == began
    return first


@pytest.fixture
def plant(start, tmp_path):
    with OpenFoamWake(tmp_path / "case", start, CONFIG, FOAM.refinement, duration=2.0) as plant:
        yield plant


def _slot_speed(plant: OpenFoamWake, jet: str) -> np.ndarray:
    """Velocity on a slot as icoFoam wrote it at the end of the last period."""
    text = plant._latest().joinpath("U").read_bytes()
    block = text[text.index(b"boundaryField") :]
    block = block[block.index(jet.encode()) :]
    uniform = re.match(rb"[^}]*?value\s+uniform \((\S+) ", block)
    assert uniform, "two faces of a symmetric parabola have one velocity"
    return np.array(float(uniform[1]))


def test_the_wake_goes_on_as_on_the_own_solver(plant):
    own = TruckWake()
    own.reset(developed_state())
    for _ in range(3):
        own.advance(0.0)
    ours, theirs = [], []
    for _ in range(10):
        ours.append(own.advance(0.0))
        theirs.append(plant.advance(0.0))
    # The coarse mesh lags a little; a wrong sign, unit or sensor order would be off by the whole amplitude of 1.3.
    assert [s.Cl for s in theirs] == pytest.approx([s.Cl for s in ours], abs=0.25)
    assert [s.Uy_probe for s in theirs] == pytest.approx([s.Uy_probe for s in ours], abs=0.15)
    assert np.mean([s.Cd for s in theirs]) == pytest.approx(np.mean([s.Cd for s in ours]), rel=0.1)
    assert np.array([s.Cp for s in theirs]) == pytest.approx(np.array([s.Cp for s in ours]), abs=0.25)
    assert theirs[-1].t == pytest.approx(2.0)


def test_a_varying_speed_gives_the_forces_of_the_own_solver(plant):
    # The stream gains 0.2 U_inf in 2 t_c. Uncorrected, the pressures that accelerate it would shift Cp on the base by
    # 2 * 0.16 * 15, about 5.
    own, wind = TruckWake(replace(FlowConfig(), substeps=40)), lambda t: 0.1 * (1.0 - cos(0.5 * pi * t)) - 0.1
    own.reset(developed_state())
    for _ in range(3):
        own.advance(0.0)
    for either in (own, plant):
        either.wind = lambda t, begin=either.t: wind(t - begin)
        either.scale(0.9)
    ours, theirs = ([either.advance(0.0) for _ in range(10)] for either in (own, plant))
    assert [s.Cd for s in theirs] == pytest.approx([s.Cd for s in ours], abs=0.12)
    assert [s.Cd_slot_pressure for s in theirs] == pytest.approx([s.Cd_slot_pressure for s in ours], abs=0.03)
    assert np.array([s.Cp for s in theirs]) == pytest.approx(np.array([s.Cp for s in ours]), abs=0.3)


def test_another_viscosity_changes_the_friction(plant):
    before = plant.advance(0.0)
    plant.set_reynolds(250.0)
    after = plant.advance(0.0)
    assert after.t == pytest.approx(before.t + 0.2)
    # Right after the change the velocity at the wall is nearly the same, so friction rises with the viscosity.
    assert after.Cd_slot_viscous / before.Cd_slot_viscous == pytest.approx(2.0, rel=0.3)


def _sample_at(plant: OpenFoamWake, substep: int, action: float | None = None) -> Sample:
    plant.advance_to(substep, action)
    return plant.sample()


def test_a_late_command_starts_its_ramp_late_and_ends_it_on_time(plant):
    begin = plant.state()
    early = [_sample_at(plant, 10, 0.05), _sample_at(plant, 20, 0.05)]
    plant.reset(begin)
    late = [_sample_at(plant, 10), _sample_at(plant, 20, 0.05)]
    assert [s.action for s in early] == pytest.approx([0.025, 0.05])
    assert [s.action for s in late] == pytest.approx([0.0, 0.05])
    assert late[1].Cd_momentum == pytest.approx(-4 * 1.2 * 0.05**2 / 0.05)
    assert _slot_speed(plant, "jetUpper") == pytest.approx(1.0, rel=1e-5)
    assert _slot_speed(plant, "jetLower") == pytest.approx(-1.0, rel=1e-5)
    # The steeper ramp accelerates more fluid: its pressure on the blowing slot is the larger one.
    assert late[1].jet_power > 1.2 * early[1].jet_power


def test_a_state_continues_the_run(plant):
    plant.advance(0.03)
    kept = plant.state()
    straight = [plant.advance(a) for a in (0.05, 0.0)]
    assert plant.reset(kept).t == pytest.approx(0.2)
    again = [plant.advance(a) for a in (0.05, 0.0)]
    assert [s.t for s in again] == [s.t for s in straight]
    # icoFoam's own restart is not exact; half a percent of the swing of Cl.
    assert [s.Cl for s in again] == pytest.approx([s.Cl for s in straight], abs=0.015)
    assert [s.Cd for s in again] == pytest.approx([s.Cd for s in straight], rel=0.01)


def test_vorticity_has_the_shear_layers_where_they_belong(plant):
    w, grid = plant.vorticity(), plant.grid
    assert w.shape == (grid.shape[0] - 1, grid.shape[1] - 1)
    x, y = grid.xf[1:-1], grid.yf[1:-1]
    side = np.abs(x - 3.0).argmin()
    # Flow to the right, at rest on the wall: clockwise above, counter-clockwise below.
    assert w[side, np.abs(y - 0.6).argmin() :][:10].min() < -1.0
    assert w[side, : np.abs(y + 0.6).argmin() + 1][-10:].max() > 1.0
    plant.advance_to(3)
    with pytest.raises(PlantError, match="end of a control period"):
        plant.vorticity()


def test_what_cannot_be_done_is_refused(plant, start):
    for _ in range(10):
        plant.advance(0.0)
    with pytest.raises(PlantError, match="past 2 t_c"):
        plant.advance(0.0)
    with pytest.raises(PlantError, match="this mesh has"):
        OpenFoamWake(plant._case.parent / "other", start, CONFIG, 0.6)
