"""The body's outline: a rectangle whose two front corners may be rounded, as the truck's are (paper, figure 1)."""

import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.config.body import TRUCK_BODY, BodyConfig
from contract.geometry import HALF_WIDTH


def signed_distance(x: npt.ArrayLike, y: npt.ArrayLike, body: BodyConfig = TRUCK_BODY) -> Array:
    """Distance to the outline in W, positive in the fluid; exact outside and inside near the outline."""
    x, y = np.asarray(x, dtype=np.float64), np.abs(np.asarray(y, dtype=np.float64))
    # A box with all corners sharp, and one with all corners rounded; the front takes the second.
    sharp = _box_distance(x, y, body.length, 0.0)
    rounded = _box_distance(x, y, body.length, body.leading_edge_radius)
    return np.where(x < 0.5 * body.length, rounded, sharp)


def _box_distance(x: Array, y: Array, length: float, radius: float) -> Array:
    qx = np.abs(x - 0.5 * length) - (0.5 * length - radius)
    qy = y - (HALF_WIDTH - radius)
    outside = np.hypot(np.maximum(qx, 0.0), np.maximum(qy, 0.0))
    inside = np.minimum(np.maximum(qx, qy), 0.0)
    return outside + inside - radius
