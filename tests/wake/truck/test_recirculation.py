"""The recirculation length of flows whose axis velocity is known."""

import numpy as np
import pytest

from contract.geometry import LENGTH
from wake.solver.flow import Flow
from wake.solver.grid import Grid, truck_grid
from wake.truck.recirculation import recirculation_length


@pytest.fixture(scope="module")
def grid() -> Grid:
    return truck_grid(0.7)


def test_it_ends_where_the_axis_turns_downstream(grid):
    """At the base at the least, at the outlet at the most. Backward flow ahead of the truck does not count."""
    for turn, length in [(0.37, 0.37), (2.0, 2.0), (3.3, 3.3), (-1.0, 0.0), (100.0, 23.0 - LENGTH)]:
        flow = Flow.zeros(grid.shape)
        ahead = grid.xf[:, None] < LENGTH
        flow.faces_u[:] = grid.xf[:, None] - LENGTH - turn - 100.0 * np.abs(grid.yc) * ahead
        assert recirculation_length(grid, flow) == pytest.approx(length, abs=1e-9)
