"""The immersed boundary against fields whose value behind the wall is known; the Poisson solver against SciPy's."""

import hashlib

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core.caching import CacheImpl
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import spsolve

from contract import geometry
from tests.examples import examples
from wake.solver import boundary, poisson
from wake.solver.grid import Grid, box_grid, truck_grid
from wake.solver.kernels import compiled
from wake.truck.surface import signed_distance


def test_grid_is_symmetric_and_smooth_and_the_one_all_shipped_data_was_recorded_on():
    grid = truck_grid()
    assert np.array_equal(grid.yf, -grid.yf[::-1])
    assert len(grid.yc) % 2 == 0
    slot_edge = grid.yf[grid.upper - grid.slot_cells]
    assert slot_edge == pytest.approx(geometry.HALF_WIDTH - geometry.JET_WIDTH, abs=1e-15)
    # Second order on a stretched grid needs neighbouring cells of nearly equal size.
    for sizes in (grid.dx, grid.dy):
        ratio = sizes[1:] / sizes[:-1]
        assert ratio.max() < 1.15 and ratio.min() > 1 / 1.15
    faces = hashlib.sha256(grid.xf.tobytes() + grid.yf.tobytes()).hexdigest()
    assert grid.shape == (443, 164)
    assert faces.startswith("613a94ecb14d5ad5")


@examples(30)
@given(length=st.floats(0.5, 15.0), refinement=st.sampled_from([0.7, 1.0, 1.4]))
def test_every_box_has_faces_on_its_walls_and_is_resolved_as_the_truck(length, refinement):
    grid, truck = box_grid(length, refinement), truck_grid(refinement)
    assert (grid.xf[grid.front], grid.xf[grid.rear]) == (0.0, length)
    assert (grid.xf[0], grid.xf[-1]) == geometry.DOMAIN_X
    assert np.array_equal(grid.yf, truck.yf)
    assert (grid.lower, grid.upper, grid.slot_cells) == (truck.lower, truck.upper, truck.slot_cells)
    assert np.array_equal(grid.dx[: grid.front], truck.dx[: truck.front])
    # Counts are whole on either side of a wall: a part is stretched by half a cell at the most.
    rounding = 1.0 + 0.6 / min(grid.rear - grid.front, grid.shape[0] - grid.rear)
    near_nose, near_base = slice(grid.front, grid.front + 6), slice(grid.rear - 2, grid.rear + 4)
    assert (grid.dx[near_nose] < 0.0135 / refinement * rounding).all()
    assert (grid.dx[near_base] < 0.0175 / refinement * rounding).all()
    ratio = grid.dx[1:] / grid.dx[:-1]
    # A coarser grid has fewer cells for the same change; the truck's own bound at refinement 1 is 1.15.
    assert max(ratio.max(), 1 / ratio.min()) < 1.0 + 0.15 / min(1.0, refinement) * rounding


def _disc(x: npt.ArrayLike, y: npt.ArrayLike) -> npt.NDArray[np.float64]:
    return np.asarray(np.hypot(x, y) - 0.5)


def _ghost_error(cells: int) -> float:
    """Largest error of the ghosts around a disc, for a smooth field that vanishes on it."""
    faces = np.linspace(-1.0, 1.0, cells + 1)
    grid = Grid(xf=faces, yf=faces)
    walls = boundary.Boundary(grid, _disc)
    x, y = np.meshgrid(grid.xf, grid.yc, indexing="ij")
    exact = np.zeros((cells + 1, cells + 2))
    exact[:, 1:-1] = _disc(x, y) * (1.0 + 0.4 * x - 0.3 * y) + _disc(x, y) ** 2
    ghosts = walls.u_ghosts
    flat = exact.reshape(-1)
    values = [
        np.dot(ghosts.weight[a:b], flat[ghosts.source[a:b]])
        for a, b in zip(ghosts.start[:-1], ghosts.start[1:], strict=True)
    ]
    return float(np.abs(np.array(values) - flat[ghosts.target]).max())


def test_ghosts_are_second_order_on_a_curved_wall():
    errors = np.array([_ghost_error(cells) for cells in (40, 80, 160)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert errors[-1] < 2e-3
    # Image points jump between cells as the grid changes, so single ratios scatter; a staircase would give 1.
    assert np.mean(orders) > 1.7, orders


def _assembled(grid: Grid, fluid: np.ndarray) -> csr_array:
    """The integrated Laplacian with cut links, cell by cell; identity in solid cells."""
    nx, ny = grid.shape
    number = np.arange(nx * ny).reshape(nx, ny)
    rows, columns, values = [], [], []

    def link(a: np.ndarray, b: np.ndarray, strength: np.ndarray) -> None:
        for row, column, sign in ((a, a, -1), (a, b, 1), (b, b, -1), (b, a, 1)):
            rows.append(row)
            columns.append(column)
            values.append(sign * strength)

    i, j = np.nonzero(fluid[1:] & fluid[:-1])
    link(number[i, j], number[i + 1, j], grid.dy[j] / grid.dxc[i + 1])
    i, j = np.nonzero(fluid[:, 1:] & fluid[:, :-1])
    link(number[i, j], number[i, j + 1], grid.dx[i] / grid.dyc[j + 1])
    outlet = number[-1]
    solid = number[~fluid]
    for index, value in ((outlet, -grid.dy / grid.dxc[-1]), (solid, np.ones(len(solid)))):
        rows.append(index)
        columns.append(index)
        values.append(value)
    triplets = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return coo_array(triplets, shape=(nx * ny, nx * ny)).tocsr()


def test_agrees_with_a_sparse_direct_solve_around_the_truck():
    grid = truck_grid(0.4)
    fluid = signed_distance(*np.meshgrid(grid.xc, grid.yc, indexing="ij")) > 0
    b = np.random.default_rng(3).standard_normal(grid.shape) * fluid
    expected = spsolve(_assembled(grid, fluid), b.reshape(-1)).reshape(grid.shape)
    phi = np.empty_like(b)
    poisson.PoissonSolver(grid, fluid).solve_into(b, phi)
    # Rounding, amplified by the conditioning of a stretched grid.
    assert np.abs(phi - expected)[fluid].max() < 1e-9 * np.abs(expected).max()


def test_where_no_folder_can_be_written_each_process_compiles(monkeypatch):
    """As in a read-only container without a home."""
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])

    @compiled("contract")
    def doubled(x):
        return 2.0 * x

    assert doubled(1.5) == 3.0
