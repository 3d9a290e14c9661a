"""The fast solver against SciPy's general sparse one."""

import numpy as np
from numba.core.caching import CacheImpl
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import spsolve

from wake.solver import poisson
from wake.solver.compiled import compiled
from wake.solver.grid import Grid, truck_grid
from wake.truck.surface import signed_distance


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
    poisson.build(grid, fluid).solve_into(b, phi)
    # Rounding, amplified by the conditioning of a stretched grid.
    assert np.abs(phi - expected)[fluid].max() < 1e-9 * np.abs(expected).max()


def test_where_no_folder_can_be_written_each_process_compiles(monkeypatch):
    """As in a read-only container without a home."""
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])

    @compiled("contract")
    def doubled(x):
        return 2.0 * x

    assert doubled(1.5) == 3.0
