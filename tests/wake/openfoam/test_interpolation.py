"""Cell values at other points, against scipy's linear interpolation."""

import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator

from wake.openfoam.plant import CellInterpolation


def test_it_is_what_scipy_interpolates_and_beyond_the_cells_the_nearest_one(coarse_mesh):
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-2.0, 12.0, 300), rng.uniform(-3.0, 3.0, 300)])
    values = np.sin(coarse_mesh.centres[:, 0]) * np.cos(coarse_mesh.centres[:, 1])
    assert CellInterpolation(coarse_mesh, points)(values) == pytest.approx(
        LinearNDInterpolator(coarse_mesh.centres, values)(points), abs=1e-12
    )
    # Beyond the cells the nearest one holds.
    centres = coarse_mesh.centres
    values = np.column_stack([2.0 + 3.0 * centres[:, 0] - centres[:, 1], centres[:, 1]])
    far = np.array([[1000.0, 0.01], [-1000.0, 0.01]])
    nearest = np.argmin(((centres[None] - far[:, None]) ** 2).sum(axis=2), axis=1)
    assert CellInterpolation(coarse_mesh, far)(values) == pytest.approx(values[nearest])
