"""Two slots at the edges of the base that blow and suck in opposition: zero net mass flow at every instant."""

import numpy as np

from contract.arrays import Array
from contract.geometry import HALF_WIDTH, JET_WIDTH
from wake.solver.grid import Grid

MOMENTUM_FACTOR = 1.2 / JET_WIDTH
"""Integral of u^2 over a slot divided by q^2, for the parabola of flow rate q."""


def slot_profile(grid: Grid) -> Array:
    """Velocity on the base's faces per unit action, shape (ny,): a parabola of flow rate +1 in the upper slot and -1
    in the lower, averaged exactly over each face (paper, section 2.1)."""

    def flow_below(y: Array) -> Array:
        s = (y - (HALF_WIDTH - JET_WIDTH)) / JET_WIDTH
        return s**2 * (3.0 - 2.0 * s)

    profile = np.zeros(grid.shape[1])
    upper = slice(grid.upper - grid.slot_cells, grid.upper)
    edges = grid.yf[upper.start : upper.stop + 1]
    profile[upper] = np.diff(flow_below(edges)) / grid.dy[upper]
    # Copied rather than evaluated, so that the two flows cancel to the last bit.
    profile[grid.lower : grid.lower + grid.slot_cells] = -profile[upper][::-1]
    return profile
