"""Sensors, slots and the text of the jets against what a linear pressure and an exact parabola give."""

import re

import numpy as np
import pytest
from scipy.integrate import quad

from contract import sensors
from wake.openfoam import wall
from wake.openfoam.wall import pressure_points, sensor_weights


@pytest.fixture(scope="module")
def probes(coarse_mesh):
    return pressure_points(coarse_mesh), sensor_weights(coarse_mesh)


def test_a_linear_pressure_is_read_exactly_on_its_side(probes):
    at, weights = probes
    # Along a wall only the coordinate on it may vary: a wall face has its cell's pressure.
    side, base = slice(0, 80), slice(80, 90)
    x, y = sensors.positions().T
    assert (weights @ (0.3 + 0.1 * at[:, 0]))[side] == pytest.approx(2 * (0.3 + 0.1 * x[side]), abs=1e-12)
    assert (weights @ (0.3 - 0.7 * at[:, 1]))[base] == pytest.approx(2 * (0.3 - 0.7 * y[base]), abs=1e-12)
    # Sides and slots are not mixed up.
    cp = weights @ np.sign(at[:, 1])
    assert cp[:40] == pytest.approx(2.0)
    assert cp[40:80] == pytest.approx(-2.0)
    # Symmetric weights: the mean of a linear pressure on a slot is that at its middle.
    assert (weights @ (1.0 + at[:, 1]))[90:] == pytest.approx((2 * 1.475, 2 * 0.525), abs=1e-12)


def test_jet_files_name_every_step_and_lead_to_one_pipe(coarse_mesh, tmp_path):
    wall.write_pipes(tmp_path, coarse_mesh, dt=0.01, steps=40, action=0.0)
    for jet in wall.JETS:
        data = tmp_path / "constant" / "boundaryData" / jet
        instants = sorted(float(item.name) for item in data.iterdir() if item.name not in ("0", "points"))
        steps = 0.01 * np.arange(1, 41)
        assert instants == pytest.approx(steps, abs=1e-7)
        # Never before the step's end, or the file would be read a step early.
        assert (np.array(instants) > steps).all()
        assert {(data / item.name).resolve() for item in data.iterdir() if item.is_symlink()} == {
            wall.pipe(tmp_path, jet).parent
        }
        assert wall.pipe(tmp_path, jet).is_fifo()
        assert re.match(r"2\n\(\n\(0 0 0\)\n\(0 0 0\)\n\)\n", (data / "0" / "U").read_text().replace("-0", "0"))


def test_jets_are_parabolas_averaged_over_each_face(coarse_mesh):
    action = 0.06
    for jet, sign, bottom in (("jetUpper", 1.0, 0.45), ("jetLower", -1.0, -0.5)):
        speed = wall.slot_velocity(coarse_mesh, jet, action)
        edges = coarse_mesh.points[coarse_mesh.patches[jet]][:, :, 1]
        assert speed[:, 1] == pytest.approx(0.0, abs=0)
        for (a, b), u in zip(edges, speed[:, 0], strict=True):
            low, high = sorted((a, b))
            scale = sign * 6.0 * action / 0.05**3
            flow = scale * quad(lambda y, bottom=bottom: (y - bottom) * (bottom + 0.05 - y), low, high)[0]
            assert u * (high - low) == pytest.approx(flow, rel=1e-12), jet
