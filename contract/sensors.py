"""The truck's 90 wall-pressure sensors: order, names, positions and mirror images (paper, figure 1).

Order: 0-39 upper side front to rear, 40-79 lower side front to rear, 80-89 base from top to bottom.
"""

from typing import Final

import numpy as np

from contract.arrays import Array
from contract.geometry import HALF_WIDTH, LEADING_EDGE_RADIUS, LENGTH
from contract.sensor_layout import SensorLayout

PER_SIDE: Final = 40
ON_BASE: Final = 10
COUNT: Final = 2 * PER_SIDE + ON_BASE

# The paper gives 0.204555 here, although its mirror image is 0.204545.
_BASE_Y: Final = (
    0.368182, 0.286364, 0.204555, 0.122727, 0.040909,
    -0.040909, -0.122727, -0.204545, -0.286364, -0.368182,
)  # fmt: skip

NAMES: Final[tuple[str, ...]] = (
    *(f"upper_{i:02d}" for i in range(PER_SIDE)),
    *(f"lower_{i:02d}" for i in range(PER_SIDE)),
    *(f"base_{i}" for i in range(ON_BASE)),
)

BASE: Final = slice(2 * PER_SIDE, COUNT)
"""Columns of the sensors on the base. The mean base Cp is the mean over these columns."""


def positions() -> Array:
    """Return the sensor coordinates in W, shape (90, 2), on the body's surface."""
    # The positions are evenly spaced between the rounded edge and the rear, without the end points. They are rounded as
    # in the paper.
    side_x = np.round(np.linspace(LEADING_EDGE_RADIUS, LENGTH, PER_SIDE + 2)[1:-1], 6)
    upper = np.column_stack([side_x, np.full(PER_SIDE, HALF_WIDTH)])
    lower = upper * (1.0, -1.0)
    base = np.column_stack([np.full(ON_BASE, LENGTH), _BASE_Y])
    return np.vstack([upper, lower, base])


TRUCK: Final = SensorLayout.of(NAMES, positions(), base=range(2 * PER_SIDE, COUNT))
"""The truck's layout."""
