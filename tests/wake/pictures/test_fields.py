import numpy as np
import pytest

from contract.errors import PlantError
from wake.pictures.fields import LevelPicture, Raster, field_levels, mean_flow, velocity

pytestmark = pytest.mark.slow  # seconds of flow


def test_fields_are_those_that_are_known(wake):
    grid, flow = wake.grid, wake.flow
    flow.faces_u[:] = np.sin(grid.xf[:, None]) * np.cos(grid.yc)
    flow.faces_v[:] = -np.cos(grid.xc[:, None]) * np.sin(grid.yf)
    near = np.ix_(np.flatnonzero((grid.xf[1:-1] > 0) & (grid.xf[1:-1] < 15)), np.flatnonzero(abs(grid.yf[1:-1]) < 1.2))
    exact = 2.0 * np.sin(grid.xf[1:-1, None]) * np.sin(grid.yf[None, 1:-1])
    # Central differences over cells of at most 0.09 W: dx^2 / 24 for each term, and as much from stretching.
    assert wake.vorticity()[near] == pytest.approx(exact[near], abs=2e-3)
    # Velocity in the cell centres.
    flow.faces_u[:], flow.faces_v[:] = 2.0 * grid.xf[:, None] + grid.yc, grid.xc[:, None] - 3.0 * grid.yf
    u, v = velocity(flow)
    x, y = grid.xc[:, None], grid.yc[None, :]
    assert u == pytest.approx(2.0 * x + y, abs=1e-12)
    assert v == pytest.approx(x - 3.0 * y, abs=1e-12)
    # A raster keeps linear fields.
    raster = Raster(grid.xc, grid.yc, (0.0, 10.0, -1.0, 1.0), 50)
    pixels = raster(3.0 * x - y)
    assert pixels.shape == (10, 50)
    # Pixels of 0.2 W, row 0 at the bottom.
    assert (raster.x[0], raster.y[0]) == pytest.approx((0.1, -0.9))
    assert pixels == pytest.approx(3.0 * raster.x[None, :] - raster.y[:, None], abs=1e-10)


def test_a_mean_leaves_out_what_is_skipped(coarse):
    with coarse.plant() as wake:
        mean = mean_flow(wake, np.array([0.01, 0.02, 0.03]), 1)
        wake.reset(coarse.start)
        flows = []
        for action in (0.01, 0.02, 0.03):
            wake.advance(action)
            flows.append(wake.flow.flat.copy())
        np.testing.assert_allclose(mean.flat, 0.5 * (flows[1] + flows[2]), rtol=0, atol=1e-14)
        with pytest.raises(PlantError, match="at least one control period"):
            mean_flow(wake, np.zeros(0))


def test_levels_are_roots_the_first_row_is_the_uppermost_and_the_body_is_empty(wake):
    # 127 (0.8 / 5)^(1/2) = 50.8; the ends of the colours are 5.
    assert field_levels(np.array([[0.8, -0.8, 0.0, 5.0, -90.0]])).tolist() == [[51, -51, 0, 127, -127]]
    grid = wake.grid
    wake.flow.flat[:] = 0.0
    # -du/dy = -y: negative above the axis.
    wake.flow.faces_u[:] = 0.5 * grid.yc[None, :] ** 2
    picture = LevelPicture(wake)
    levels = picture.levels()
    assert picture.size == (levels.shape[1], levels.shape[0]) == (480, 180)
    left, right, low, high = picture.view
    assert (right - left) / 480 == pytest.approx((high - low) / 180)
    # In the free stream: the rows' centres are y, and the level is 127 (|y| / 5)^(1/2), rounded.
    y = high - (np.arange(180) + 0.5) * (high - low) / 180
    assert levels[:, -1] == pytest.approx(-127 * np.sign(y) * np.sqrt(np.abs(y) / 5.0), abs=2.0)
    base = round((wake.body.length - left) / (right - left) * 480)
    assert not levels[90 - 19 : 90 + 19, : base - 1].any()
    assert levels[90 - 19, base + 2] != 0
