"""The sensor layout of a body in the project's own solver. The truck has the paper's layout; other bodies have sensors
with equal spacing.

Order and names follow one rule for every body: `upper_00` .. front to rear, `lower_00` .. front to rear, `base_0` ..
from top to bottom. The body's settings give the number of each kind.
"""

import numpy as np

from contract import sensors
from contract.config.body import TRUCK_BODY, BodyConfig
from contract.geometry import HALF_WIDTH, JET_WIDTH
from contract.sensor_layout import SensorLayout


def layout_of(body: BodyConfig) -> SensorLayout:
    """Return the sensors' names and their positions on the body's surface, in W."""
    if body == TRUCK_BODY:
        return sensors.TRUCK
    sides, on_base = body.sensors_per_side, body.sensors_on_base
    # The paper leaves out the end points and rounds the positions, so this function does too.
    side_x = np.round(np.linspace(body.leading_edge_radius, body.length, sides + 2)[1:-1], 6)
    between_slots = np.linspace(1.0, -1.0, on_base + 2)[1:-1] * (HALF_WIDTH - JET_WIDTH)
    # The two halves are made exact mirror images before they are rounded; + 0.0 turns -0.0 into 0.0.
    base_y = np.round(0.5 * (between_slots - between_slots[::-1]), 6) + 0.0
    upper = np.column_stack([side_x, np.full(sides, HALF_WIDTH)])
    base = np.column_stack([np.full(on_base, body.length), base_y])
    return SensorLayout.of(
        (
            *(f"upper_{i:02d}" for i in range(sides)),
            *(f"lower_{i:02d}" for i in range(sides)),
            *(f"base_{i}" for i in range(on_base)),
        ),
        np.vstack([upper, upper * (1.0, -1.0), base]),
        base=range(2 * sides, 2 * sides + on_base),
    )
