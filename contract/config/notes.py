"""The metadata of a setting's type that is only displayed: the unit, and the source of the default.

A number without a unit is a ratio, or a count whose name states what is counted. A field without a source has the
source of its section.
"""

from dataclasses import dataclass
from typing import Final, Literal


@dataclass(frozen=True)
class Source:
    """The source of a default value: metadata of an `Annotated` type, or of a class of settings. `place` is the place
    in the paper, or the name of the standard. `note` states how the default follows from the source, or the reason for
    a default of the project. `page` is a page of `docs/` with more about the default. Each text may be empty."""

    kind: Literal["paper", "standard", "ours"]
    place: str = ""
    note: str = ""
    page: str = ""

    @property
    def name(self) -> str:
        """The source and the place in it, as one text: "paper, section 2.1", "SAE J2284-4", "ours"."""
        return self.place if self.kind == "standard" else ", ".join(filter(None, (self.kind, self.place)))


def paper(place: str, note: str = "") -> Source:
    """Mark a default as the number at a place in the paper, such as "section 2.1". If the number is not stated there,
    `note` says how it follows. Equations have the manuscript's numbers, which do not restart with each section."""
    return Source("paper", place=place, note=note)


def standard(name: str, note: str) -> Source:
    """Mark a default as a number from a published standard."""
    return Source("standard", place=name, note=note)


def ours(reason: str, *, page: str = "") -> Source:
    """Mark a default as the project's own number. `reason` justifies the number, and `page` says more about it."""
    return Source("ours", note=reason, page=page)


@dataclass(frozen=True)
class Unit:
    """A unit, as it is written after a number. It is metadata of an `Annotated` type."""

    name: str


WIDTHS: Final = Unit("W")
"""Unit of lengths: the width W of the body."""
TIME: Final = Unit("t_c")
"""Unit of times: the convective time, t_c = W / U_inf."""
FREQUENCY: Final = Unit("1/t_c")
FLOW_RATE: Final = Unit("U_inf W")
"""Unit of actions: flow rate of the jets per unit span."""
STEPS: Final = Unit("control steps")
PERIODS: Final = Unit("periods")
"""Unit of durations on the vehicle's clock: the control period."""
FRAMES: Final = Unit("frames")
BIT_RATE: Final = Unit("bit/s")
MILLISECONDS: Final = Unit("ms")
PASSES: Final = Unit("passes")
"""Unit of training lengths: passes over the recording."""
WINDOWS: Final = Unit("windows")
"""Unit of counts of windows; a window is a number of consecutive rows of a recording."""
