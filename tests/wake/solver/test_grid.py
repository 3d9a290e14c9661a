import numpy as np
import pytest

from contract import geometry
from contract.errors import ConfigError
from wake.solver.grid import bilinear, truck_grid


@pytest.mark.parametrize("refinement", [0.5, 1.0, 1.7])
def test_faces_lie_on_walls_and_slot_edges(refinement: float) -> None:
    grid = truck_grid(refinement)
    assert grid.xf[grid.front] == 0.0
    assert grid.xf[grid.rear] == geometry.LENGTH
    assert grid.yf[[grid.lower, grid.upper]] == pytest.approx([-0.5, 0.5], abs=0)
    slot_edge = grid.yf[grid.upper - grid.slot_cells]
    assert slot_edge == pytest.approx(geometry.HALF_WIDTH - geometry.JET_WIDTH, abs=1e-15)
    assert (grid.xf[0], grid.xf[-1]) == geometry.DOMAIN_X
    assert (grid.yf[0], grid.yf[-1]) == geometry.DOMAIN_Y


def test_grid_is_symmetric_and_smooth() -> None:
    grid = truck_grid()
    assert np.array_equal(grid.yf, -grid.yf[::-1])
    assert len(grid.yc) % 2 == 0
    # Second order on a stretched grid needs neighbouring cells of nearly equal size.
    for sizes in (grid.dx, grid.dy):
        ratio = sizes[1:] / sizes[:-1]
        assert ratio.max() < 1.15 and ratio.min() > 1 / 1.15


def test_too_coarse_for_the_slots_is_refused() -> None:
    with pytest.raises(ConfigError, match="cells a slot"):
        truck_grid(0.2)


def test_bilinear_reproduces_a_bilinear_field() -> None:
    x, y = np.array([0.0, 0.3, 1.0]), np.array([-1.0, 0.5, 0.7])
    field = 2.0 + 3.0 * x[:, None] - y[None, :] + 0.5 * x[:, None] * y[None, :]
    value = sum(w * field[node] for node, w in bilinear(x, y, 0.8, 0.1))
    assert value == pytest.approx(2.0 + 2.4 - 0.1 + 0.04, abs=1e-13)
