"""The mesh against the analytic outline and domain, in the plane and as the files that OpenFOAM reads."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from contract.config.plant import FlowConfig
from contract.errors import ConfigError
from contract.geometry import LENGTH
from wake.openfoam import case, foam_files
from wake.openfoam.mesh import Mesh, truck_mesh

RADIUS = 0.118
BODY = 7.647 - (2.0 - np.pi / 2.0) * RADIUS**2


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return truck_mesh(0.87)


def _lengths(mesh: Mesh, name: str) -> np.ndarray:
    return np.linalg.norm(np.diff(mesh.points[mesh.patches[name]], axis=1)[:, 0], axis=1)


def _areas(mesh: Mesh) -> np.ndarray:
    """By the cells' diagonals, positive if the corners are counter-clockwise."""
    a, b, c, d = np.moveaxis(mesh.points[mesh.cells], 1, 0)
    (x, y), (to_x, to_y) = (c - a).T, (d - b).T
    return 0.5 * (x * to_y - y * to_x)


def _arc_cells(mesh: Mesh) -> int:
    x, y = mesh.patch_centres("truck").T
    return int(np.count_nonzero((x < RADIUS) & (np.abs(y) > 0.5 - RADIUS))) // 2


def test_the_cells_fill_the_domain_around_the_body_and_are_symmetric(mesh):
    areas = _areas(mesh)
    assert (areas > 0).all()
    # The chords of the rounded corners lie in the body: each leaves a segment of the disc to the fluid.
    angle = 0.5 * np.pi / _arc_cells(mesh)
    segments = 2 * _arc_cells(mesh) * 0.5 * RADIUS**2 * (angle - np.sin(angle))
    assert areas.sum() == pytest.approx(30.0 * 15.0 - BODY + segments, abs=1e-9)
    distance, partner = KDTree(mesh.centres).query(mesh.centres * (1.0, -1.0))
    assert distance.max() < 1e-12
    assert len(np.unique(partner)) == len(mesh.cells)
    assert areas[partner] == pytest.approx(areas, rel=1e-9)


def test_patches_are_as_long_as_the_outline_and_lie_on_it(mesh):
    arc = 2 * _arc_cells(mesh) * 2.0 * RADIUS * np.sin(0.25 * np.pi / _arc_cells(mesh))
    front, sides, base = 1.0 - 2 * RADIUS, 2 * (LENGTH - RADIUS), 0.9
    wanted = {
        "inlet": 15.0, "outlet": 15.0, "sides": 60.0,
        "truck": front + arc + sides + base, "jetUpper": 0.05, "jetLower": 0.05,
    }  # fmt: skip
    assert {name: _lengths(mesh, name).sum() for name in mesh.patches} == pytest.approx(wanted, abs=1e-9)
    # Wall vertices lie on the outline.
    x, y = mesh.points[np.unique(mesh.patches["truck"])].T
    on_front, on_side, on_base = np.abs(x) < 1e-12, np.abs(np.abs(y) - 0.5) < 1e-12, np.abs(x - LENGTH) < 1e-12
    on_arc = np.abs(np.hypot(x - RADIUS, np.abs(y) - (0.5 - RADIUS)) - RADIUS) < 1e-12
    assert (on_front | on_side | on_base | (on_arc & (x < RADIUS))).all()
    # The slots are the outermost parts of the base.
    for name, span in (("jetUpper", (0.45, 0.5)), ("jetLower", (-0.5, -0.45))):
        points = mesh.points[mesh.patches[name]].reshape(-1, 2)
        assert points[:, 0] == pytest.approx(LENGTH, abs=0)
        assert (points[:, 1].min(), points[:, 1].max()) == pytest.approx(span, abs=1e-12)


def test_refinement_divides_the_spacings():
    mesh, fine = truck_mesh(1.0), truck_mesh(2.0)
    assert len(fine.cells) == pytest.approx(4 * len(mesh.cells), rel=0.02)
    assert _lengths(fine, "truck").max() == pytest.approx(0.5 * _lengths(mesh, "truck").max(), rel=0.02)
    with pytest.raises(ConfigError, match=r"refinement = 0\.3.*at least 2"):
        truck_mesh(0.3)
    walls = mesh.patch_centres("truck"), mesh.centres[mesh.patch_cells["truck"]]
    half_cell = np.linalg.norm(walls[1] - walls[0], axis=1)
    on_base = np.abs(walls[0][:, 0] - LENGTH) < 1e-9
    # A tenth of play for the whole number of cells; on the arc the chord's sagitta adds to it.
    assert 2 * half_cell[~on_base] == pytest.approx(0.0125, rel=0.1)
    assert 2 * half_cell[on_base] == pytest.approx(0.016, rel=0.1)


def _read_list(path: Path) -> list[str]:
    body = path.read_text(encoding="ascii").split("}\n", 1)[1]
    found = re.fullmatch(r"\s*(\d+)\n\(\n(.*)\n\)\n", body, re.DOTALL)
    assert found is not None
    count, items = found.groups()
    lines = items.split("\n")
    assert len(lines) == int(count)
    return lines


def test_the_written_cells_are_closed_and_their_faces_look_outwards(coarse_mesh, tmp_path):
    foam_files.write_poly_mesh(coarse_mesh, tmp_path)
    points = np.array([line.strip("()").split() for line in _read_list(tmp_path / "points")], dtype=float)
    faces = np.array([line[2:-1].split() for line in _read_list(tmp_path / "faces")], dtype=int)
    owner, neighbour = (np.array(_read_list(tmp_path / name), dtype=int) for name in ("owner", "neighbour"))
    corner = points[faces]
    # Vector area of a flat quadrilateral: half the cross product of its diagonals.
    area = 0.5 * np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1])
    inside = len(neighbour)
    closed = np.zeros((len(coarse_mesh.cells), 3))
    volume = np.zeros(len(coarse_mesh.cells))
    np.add.at(closed, owner, area)
    np.add.at(closed, neighbour, -area[:inside])
    # Gauss: the volume is a third of the flux of the position.
    flux = (corner.mean(axis=1) * area).sum(axis=1) / 3.0
    np.add.at(volume, owner, flux)
    np.add.at(volume, neighbour, -flux[:inside])
    assert np.abs(closed).max() < 1e-12
    # The centre of a face as the mean of its corners is exact for parallelograms; on the fan's trapezia only the
    # planes' share is inexact, and their z is the same everywhere.
    assert volume == pytest.approx(_areas(coarse_mesh), rel=1e-9)
    # Faces and patches are in the order that OpenFOAM wants.
    keys = list(zip(owner[:inside], neighbour, strict=True))
    assert keys == sorted(keys) and (owner[:inside] < neighbour).all()
    assert len(np.unique(np.sort(faces, axis=1), axis=0)) == len(faces)
    text = (tmp_path / "boundary").read_text(encoding="ascii")
    for name, kind, size, start in re.findall(r"(\w+)\s*\{\s*type (\w+);\s*nFaces (\d+);\s*startFace (\d+);", text):
        assert (int(start), kind) == (inside, {"truck": "wall", "planes": "empty"}.get(name, "patch"))
        inside += int(size)
    assert inside == len(faces)


@pytest.mark.skipif(shutil.which("checkMesh") is None, reason="needs checkMesh (Debian package openfoam)")
def test_checkmesh_finds_nothing_wrong(coarse_mesh, tmp_path):
    case.write_mesh(tmp_path, coarse_mesh)
    case.write_settings(
        tmp_path, coarse_mesh, FlowConfig(), end=1.0, dt=np.float64(0.01), steps_per_write=100, steps_per_sample=20
    )
    said = subprocess.run(
        ["checkMesh"], cwd=tmp_path, env={"WM_PROJECT_DIR": "/usr/share/openfoam", **os.environ},
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert "Mesh OK." in said
    assert "***" not in said
