"""What icoFoam writes, written here by hand: fields, measurements, states. Sensors, slots and the text of the jets
against what a linear pressure and an exact parabola give."""

import re
import struct
from math import pi
from unittest.mock import MagicMock

import numpy as np
import pytest
from scipy.integrate import quad

from contract import sensors
from contract.config.plant import FlowConfig, OpenFoamConfig
from contract.errors import PlantError
from contract.geometry import DOMAIN_X, JET_WIDTH, LEADING_EDGE_RADIUS, LENGTH
from tests.wake.conftest import field
from wake.openfoam import case, foam_files, state
from wake.openfoam.case import pressure_points, sensor_weights
from wake.openfoam.measurements import Follower, Instruments, Readings, read_at


def test_fields_are_read_as_written():
    assert foam_files.parse_cells(field([1.5, -2.0, 1e-300]), "p").tolist() == [1.5, -2.0, 1e-300]
    assert foam_files.parse_cells(field([[1, 2, 3], [4, 5, 6]]), "U").tolist() == [[1, 2, 3], [4, 5, 6]]
    for content, what in (
        (field([1.0, 2.0, 3.0]).split(b")\n;")[0][:-11], "p is truncated: it has 13 of the field's 24 bytes"),
        (b"format ascii;\ninternalField   nonuniform List<scalar>\n1\n(1\n)", "must hold a binary list"),
    ):
        with pytest.raises(PlantError, match=what):
            foam_files.parse_cells(content, "p")


def test_a_time_that_is_not_written_to_its_end_does_not_count_and_is_removed_before_the_run_goes_on(
    coarse_mesh, tmp_path, monkeypatch
):
    assert foam_files.latest(tmp_path) is None
    whole = dict.fromkeys(foam_files.FIELDS, field([1.0, 2.0]))
    cut, missing = {**whole, "phi_0": whole["phi_0"][:-5]}, {name: whole[name] for name in ("U", "p")}
    times = {"0": {"p": b""}, "5": whole, "10": whole, "9.5": whole, "15": cut, "20": missing, "system": {}}
    for time, files in {**times, "constant": {}}.items():
        (tmp_path / time).mkdir()
        for name, content in files.items():
            (tmp_path / time / name).write_bytes(content)
    assert foam_files.latest(tmp_path) == tmp_path / "10"
    there = set[str]()

    def begun(folder):
        there.update(item.name for item in folder.iterdir())
        return MagicMock()

    monkeypatch.setattr(state, "IcoFoam", begun)
    state._settle(tmp_path, coarse_mesh, FlowConfig(), OpenFoamConfig(develop_time=20.0), lambda t, total: None)
    assert there == {"0", "5", "9.5", "10", "system", "constant"}


def _write_measurements(folder, start: str, times, *, probes: int, value=lambda t: t) -> None:
    def put(name: str, file: str, line) -> None:
        path = folder / "postProcessing" / name / start / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("# Time\n" + "".join(f"{t}  {line(value(t))}\n" for t in times))

    for index, name in enumerate(("forcesTruck", "forcesJetUpper", "forcesJetLower"), start=1):
        put(name, "force.dat", lambda v, k=index: f"({3 * v * k} {v} 0) ({2 * v * k} {v} 0) ({v * k} 0 0)")
    put("wallPressures", "p", lambda v: " ".join([f"{v}"] * probes))
    put("wakeProbe", "U", lambda v: f"(1 {v} 0)")


def test_a_sample_is_made_of_forces_per_unit_of_half_rho_u_squared(coarse_mesh, tmp_path):
    _write_measurements(tmp_path, "0", [0.2], probes=len(pressure_points(coarse_mesh)), value=lambda t: 0.1)
    sample = Instruments(coarse_mesh).sample(Follower(tmp_path).read(), t=7.0, action=0.05)
    assert (sample.t, sample.action, sample.Uy_probe) == (7.0, 0.05, 0.1)
    assert (sample.Cd, sample.Cl) == pytest.approx((0.6, 0.2))
    # Slots two and three in the hand-made files, each per unit of half.
    assert (sample.Cd_slot_pressure, sample.Cd_slot_viscous) == pytest.approx((2.0, 1.0))
    assert sample.Cp == pytest.approx(np.full(90, 0.2))
    # The same pressure on both slots: what one jet does, the other undoes.
    assert sample.jet_power == pytest.approx(0.0, abs=1e-15)
    # Two slots of momentum flux 6/5 q^2 / width, per unit of half.
    assert sample.Cd_momentum == pytest.approx(-2 * 2 * 1.2 * 0.05**2 / 0.05)


def test_the_pressures_that_accelerate_the_stream_are_taken_out(coarse_mesh):
    # A fluid at rest relative to the body: icoFoam has only the gradient of the acceleration, and the vehicle nothing.
    rate, area = 0.3, LENGTH - 2.0 * (1.0 - 0.25 * pi) * LEADING_EDGE_RADIUS**2
    forces = np.zeros((3, 3, 3))
    # Both slots face downstream; the rest of the body gets what is left of the buoyancy.
    forces[1:, :2, 0] = rate * (LENGTH - DOMAIN_X[1]) * JET_WIDTH
    forces[0, :2, 0] = rate * area - forces[1:, 0, 0].sum()
    pressures = -rate * (pressure_points(coarse_mesh)[:, 0] - DOMAIN_X[1])
    readings = Readings(forces=forces, pressures=pressures, wake=np.array([1.0, 0.0, 0.0]))
    sample = Instruments(coarse_mesh).sample(readings, t=1.0, action=0.05, acceleration=rate)
    assert sample.Cp == pytest.approx(np.zeros(90), abs=1e-12)
    # The mesh has chords in place of the arcs.
    assert (sample.Cd, sample.Cd_slot_pressure) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_a_scaled_field_is_scaled_in_all_cells_and_on_all_patches():
    inside = field([[1, 2, 3], [4, 5, 6]])
    patches = b"{\ninlet { type fixedValue; value uniform (1 0 0); }\nouter { value nonuniform List<scalar> \n2\n("
    patches += struct.pack("<2d", 7.0, 8.0) + b"); }\nsides { type slip; value uniform 3; }\n}"
    changed = foam_files.scaled(inside.replace(b"{}", patches), 0.5)
    assert foam_files.parse_cells(changed, "U").tolist() == [[0.5, 1, 1.5], [2, 2.5, 3]]
    assert b"value uniform (0.5 0 0);" in changed and b"slip; value uniform 1.5;" in changed
    assert struct.pack("<2d", 3.5, 4.0) in changed and len(changed) == len(inside) - 2 + len(patches) + 4


def test_only_the_newest_whole_line_is_read(coarse_mesh, tmp_path):
    probes = len(pressure_points(coarse_mesh))
    _write_measurements(tmp_path, "0", [0.1, 0.2], probes=probes)
    follower = Follower(tmp_path)
    assert follower.read().wake[1] == 0.2
    with pytest.raises(PlantError, match="no new measurement"):
        follower.read()
    _write_measurements(tmp_path, "0", [0.1, 0.2, 0.3], probes=probes)
    with (tmp_path / "postProcessing/wakeProbe/0/U").open("a") as file:
        file.write("0.4 (1 0")
    assert follower.read().wake[1] == 0.3


def test_a_continued_case_has_each_time_once(tmp_path):
    _write_measurements(tmp_path, "0", [1, 2, 3, 4, 5], probes=4)
    # Continued from the state written at 3.
    _write_measurements(tmp_path, "3", [4, 5, 6], probes=4, value=lambda t: 10 * t)
    assert [read_at(tmp_path, t).wake[1] for t in (1.0, 3.0, 4.0, 6.0)] == [1, 3, 40, 60]


def test_missing_measurements_and_those_of_another_mesh_are_named(coarse_mesh, tmp_path):
    with pytest.raises(PlantError, match="no measurements"):
        Follower(tmp_path).read()
    _write_measurements(tmp_path, "0", [0.2], probes=5)
    with pytest.raises(PlantError, match="5 pressures were read"):
        Instruments(coarse_mesh).sample(Follower(tmp_path).read(), t=3.0, action=0.0)


def test_a_state_survives_its_file_and_others_are_refused(tmp_path, monkeypatch):
    rng = np.random.default_rng(1)
    cells = {"U": field([[1, 2, 3]]), "p": field([4.0])}
    kept = state.FoamState(
        files={**cells, "phi": b"\x00\xff", "U_0": b"", "phi_0": b"1"},
        dt=0.01,
        readings=Readings(forces=rng.random((3, 3, 3)), pressures=rng.random(7), wake=rng.random(3)),
        action=0.02,
        substep=60,
    )
    state.save(tmp_path / "state.npz", kept, "made so")
    back, facts = state.load(tmp_path / "state.npz")
    assert facts == "made so"
    assert (back.files, back.dt, back.action, back.substep) == (kept.files, 0.01, 0.02, 60)
    assert (back.velocity.tolist(), back.pressure.tolist()) == ([[1, 2]], [4])
    for name in ("forces", "pressures", "wake"):
        assert np.array_equal(getattr(back.readings, name), getattr(kept.readings, name))
    path = tmp_path / "state.npz"
    path.write_bytes(b"PK\x03\x04 not a zip")
    for wrong in (path, tmp_path / "none.npz"):
        with pytest.raises(PlantError, match="is not a state of the openfoam plant"):
            state.load(wrong)
    monkeypatch.setattr(state, "STATE_SCHEMA", "stillwake-openfoam/0")
    state.save(path, kept, "")
    monkeypatch.undo()
    with pytest.raises(PlantError, match=r"stillwake-openfoam/0.*reads 'stillwake-openfoam/1'"):
        state.load(path)


def test_a_linear_pressure_is_read_exactly_on_its_side(coarse_mesh):
    at, weights = pressure_points(coarse_mesh), sensor_weights(coarse_mesh)
    # Along a wall only the coordinate on it may vary: a wall face has its cell's pressure.
    side, base = slice(0, 80), slice(80, 90)
    x, y = sensors.TRUCK.positions.T
    assert (weights @ (0.3 + 0.1 * at[:, 0]))[side] == pytest.approx(2 * (0.3 + 0.1 * x[side]), abs=1e-12)
    assert (weights @ (0.3 - 0.7 * at[:, 1]))[base] == pytest.approx(2 * (0.3 - 0.7 * y[base]), abs=1e-12)
    # Sides and slots are not mixed up.
    cp = weights @ np.sign(at[:, 1])
    assert cp[:40] == pytest.approx(2.0)
    assert cp[40:80] == pytest.approx(-2.0)
    # Symmetric weights: the mean of a linear pressure on a slot is that at its middle.
    assert (weights @ (1.0 + at[:, 1]))[90:] == pytest.approx((2 * 1.475, 2 * 0.525), abs=1e-12)


def test_jet_files_name_every_step_and_lead_to_one_pipe(coarse_mesh, tmp_path):
    case.write_pipes(tmp_path, coarse_mesh, dt=0.01, steps=40, action=0.0)
    for jet in case.JETS:
        data = tmp_path / "constant" / "boundaryData" / jet
        instants = sorted(float(item.name) for item in data.iterdir() if item.name not in ("0", "points"))
        steps = 0.01 * np.arange(1, 41)
        assert instants == pytest.approx(steps, abs=1e-7)
        # Never before the step's end, or the file would be read a step early.
        assert (np.array(instants) > steps).all()
        assert {(data / item.name).resolve() for item in data.iterdir() if item.is_symlink()} == {
            case.pipe(tmp_path, jet).parent
        }
        assert case.pipe(tmp_path, jet).is_fifo()
        assert re.match(r"2\n\(\n\(0 0 0\)\n\(0 0 0\)\n\)\n", (data / "0" / "U").read_text().replace("-0", "0"))


def test_jets_are_parabolas_averaged_over_each_face(coarse_mesh):
    action = 0.06
    for jet, sign, bottom in (("jetUpper", 1.0, 0.45), ("jetLower", -1.0, -0.5)):
        speed = case.patch_velocity(coarse_mesh, jet, action, stream=1.3)
        edges = coarse_mesh.points[coarse_mesh.patches[jet]][:, :, 1]
        assert speed[:, 1] == pytest.approx(0.0, abs=0)
        for (a, b), u in zip(edges, speed[:, 0], strict=True):
            low, high = sorted((a, b))
            scale = sign * 6.0 * action / 0.05**3
            flow = scale * quad(lambda y, bottom=bottom: (y - bottom) * (bottom + 0.05 - y), low, high)[0]
            assert u * (high - low) == pytest.approx(flow, rel=1e-12), jet
