"""The wall-pressure sensors of a body: order, names, positions and mirror images. The truck has 90 (paper, figure 1).

Every body has the same order: `upper_00` .. from front to rear, `lower_00` .. from front to rear, `base_0` .. from top
to bottom. The truck has 40 sensors on each side and 10 on the base.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from contract.arrays import Array
from contract.geometry import HALF_WIDTH, LEADING_EDGE_RADIUS, LENGTH
from contract.sensor_layout import SensorLayout

# The paper gives 0.204555 here, but 0.204545 for the mirror image.
_BASE_Y: Final = (
    0.368182, 0.286364, 0.204555, 0.122727, 0.040909,
    -0.040909, -0.122727, -0.204545, -0.286364, -0.368182,
)  # fmt: skip
PER_SIDE: Final = 40
COUNT: Final = 2 * PER_SIDE + len(_BASE_Y)
BASE: Final = slice(2 * PER_SIDE, COUNT)
"""Columns of the sensors on the base. The base pressure is the mean over these columns."""


def spaced(length: float, radius: float, per_side: int, base_y: Sequence[float] | Array) -> SensorLayout:
    """Return the layout of a body with rounded front corners: `per_side` sensors on each side, evenly spaced between
    the rounded edge and the base, and sensors at `base_y` on the base. All lengths are in W."""
    # As in the paper, the end points are left out and the positions are rounded.
    side_x = np.round(np.linspace(radius, length, per_side + 2)[1:-1], 6)
    upper = np.column_stack([side_x, np.full(per_side, HALF_WIDTH)])
    base = np.column_stack([np.full(len(base_y), length), base_y])
    sides = [f"{side}_{i:02d}" for side in ("upper", "lower") for i in range(per_side)]
    return SensorLayout.of(
        [*sides, *(f"base_{i}" for i in range(len(base_y)))],
        np.vstack([upper, upper * (1.0, -1.0), base]),
        base=range(2 * per_side, 2 * per_side + len(base_y)),
    )


TRUCK: Final = spaced(LENGTH, LEADING_EDGE_RADIUS, PER_SIDE, _BASE_Y)
"""The truck's layout."""
NAMES: Final = TRUCK.names
