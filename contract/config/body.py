"""The settings of the body's shape and sensors, and the layout of sensors that follows from these settings."""

from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np

from contract import sensors
from contract.config.notes import WIDTHS, paper
from contract.config.rules import Settings, require, within
from contract.geometry import HALF_WIDTH, JET_WIDTH, LEADING_EDGE_RADIUS, LENGTH
from contract.sensor_layout import SensorLayout

_NO_SPACE: Final = (
    "a shorter body has no space for the grid between nose and base, and behind a longer body the domain is too short "
    "for the wake"
)
_RADIUS: Final = within(0, HALF_WIDTH, f"0 is a sharp edge, {HALF_WIDTH} a round nose")


@dataclass(frozen=True, kw_only=True)
class BodyConfig(Settings, source=paper("section 2.1")):
    """The body: a box of width 1 with its front at x = 0, two jets at the edges of its base, and pressure sensors.

    The defaults describe the truck. Other bodies work only in the project's own solver, and need a developed wake from
    `stillwake develop`.
    """

    length: Annotated[float, within(0.5, 15, _NO_SPACE), WIDTHS] = LENGTH
    """Length of the body; 1 gives a square cylinder."""
    leading_edge_radius: Annotated[float, _RADIUS, WIDTHS] = LEADING_EDGE_RADIUS
    """Radius of the two front corners; 0 leaves them sharp."""
    sensors_per_side: Annotated[int, within(1, 450, "a layout has at most 1000 sensors")] = 40
    """Number of sensors on each side, evenly spaced between the rounded edge and the base."""
    sensors_on_base: Annotated[int, within(1, 100, "a layout has at most 1000 sensors")] = 10
    """Number of sensors on the base, evenly spaced between the two slots."""

    def _check_together(self) -> None:
        require(self.leading_edge_radius <= 0.5 * self.length, self, "leading_edge_radius", "at most half the length")

    @property
    def wake_probe(self) -> tuple[float, float]:
        """Position of the wake probe, which measures the transverse velocity. The probe is as far behind the base as
        the truck's probe, which is at (10, 0)."""
        # Rounding makes the truck's value exactly 10.
        return round(self.length + 2.353, 9), 0.0


TRUCK_BODY: Final = BodyConfig()
"""The truck with its 90 sensors."""


def layout_of(body: BodyConfig) -> SensorLayout:
    """Return the names of the sensors and their positions on the body's surface, in W. The truck has the positions in
    the paper; other bodies have equally spaced sensors."""
    if body == TRUCK_BODY:
        return sensors.TRUCK
    between_slots = np.linspace(1.0, -1.0, body.sensors_on_base + 2)[1:-1] * (HALF_WIDTH - JET_WIDTH)
    # The two halves are made exact mirror images before they are rounded. Adding 0.0 turns -0.0 into 0.0.
    base_y = np.round(0.5 * (between_slots - between_slots[::-1]), 6) + 0.0
    return sensors.spaced(body.length, body.leading_edge_radius, body.sensors_per_side, base_y)
