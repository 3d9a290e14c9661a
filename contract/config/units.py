"""What a setting is counted in, stated in its type for people; nothing is converted.

    develop_time: Annotated[Positive[float], TIME] = 50.0

A number without a unit is a ratio, or counts what its name states.
"""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Unit:
    """Metadata of an `Annotated` type: a unit as it is written behind a number."""

    name: str


WIDTHS: Final = Unit("W")
"""Widths of the body."""
TIME: Final = Unit("t_c")
"""Convective times, W / U_inf."""
FREQUENCY: Final = Unit("1/t_c")
FLOW_RATE: Final = Unit("U_inf W")
"""Flow rate of the jets by unit span: the unit of actions."""
STEPS: Final = Unit("control steps")
PERIODS: Final = Unit("periods")
"""Control periods, on the clock of the vehicle."""
FRAMES: Final = Unit("frames")
BIT_RATE: Final = Unit("bit/s")
MILLISECONDS: Final = Unit("ms")
PASSES: Final = Unit("passes")
"""Over the recording."""
WINDOWS: Final = Unit("windows")
"""Stretches of consecutive rows of a recording."""
