"""The outline of the body, a rectangle whose front corners may be rounded (paper, figure 1), and its jets.

Two slots at the edges of the base act in opposition, one blowing while the other sucks, so that the net mass flow is
zero at every instant.
"""

import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.config.body import TRUCK_BODY, BodyConfig
from contract.geometry import HALF_WIDTH, JET_WIDTH
from wake.solver.grid import Grid


def signed_distance(x: npt.ArrayLike, y: npt.ArrayLike, body: BodyConfig = TRUCK_BODY) -> Array:
    """Return the distance to the outline in W, positive in the fluid. The distance is exact outside the body. Inside,
    it is exact near the outline."""
    x, y = np.asarray(x, dtype=np.float64), np.abs(np.asarray(y, dtype=np.float64))
    # One box has only sharp corners, the other box has only rounded corners, like the front of the body.
    sharp = _box_distance(x, y, body.length, 0.0)
    rounded = _box_distance(x, y, body.length, body.leading_edge_radius)
    return np.where(x < 0.5 * body.length, rounded, sharp)


def _box_distance(x: Array, y: Array, length: float, radius: float) -> Array:
    qx = np.abs(x - 0.5 * length) - (0.5 * length - radius)
    qy = y - (HALF_WIDTH - radius)
    outside = np.hypot(np.maximum(qx, 0.0), np.maximum(qy, 0.0))
    inside = np.minimum(np.maximum(qx, qy), 0.0)
    return outside + inside - radius


MOMENTUM_FACTOR = 1.2 / JET_WIDTH
"""Integral of u^2 over a slot divided by q^2, for a parabolic jet with flow rate q."""


def slot_profile(grid: Grid) -> Array:
    """Return the velocity on the base's faces per unit action, shape (ny,): a parabola of flow rate +1 in the upper
    slot and -1 in the lower slot, averaged exactly over each face (paper, section 2.1)."""

    def flow_below(y: Array) -> Array:
        s = (y - (HALF_WIDTH - JET_WIDTH)) / JET_WIDTH
        return s**2 * (3.0 - 2.0 * s)

    profile = np.zeros(grid.shape[1])
    upper = slice(grid.upper - grid.slot_cells, grid.upper)
    edges = grid.yf[upper.start : upper.stop + 1]
    profile[upper] = np.diff(flow_below(edges)) / grid.dy[upper]
    # The lower slot's profile is a mirrored copy, so that the two flow rates cancel bit for bit.
    profile[grid.lower : grid.lower + grid.slot_cells] = -profile[upper][::-1]
    return profile
