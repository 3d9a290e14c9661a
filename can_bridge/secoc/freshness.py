"""The freshness value: a number that a sender never uses twice under one key."""

from dataclasses import dataclass
from typing import Final, Self

LARGEST_HALF: Final = 0xFFFFFFFF
"""The largest number of a power cycle, and of a frame in one."""
LARGEST: Final = 0xFFFFFFFFFFFFFFFF


@dataclass(frozen=True, kw_only=True)
class Freshness:
    """The freshness of one sender, as AUTOSAR SecOC has it with a trip counter and a message counter. Raises ValueError
    for a half that does not fit 32 bits.

    Attributes:
        trip: power cycles, this one included; from 1 on, so that every value is greater than 0.
        count: frames of the message sent in this one before.
    """

    trip: int = 1
    count: int = 0

    def __post_init__(self) -> None:
        for name, value, least in (("trip", self.trip, 1), ("count", self.count, 0)):
            if not least <= value <= LARGEST_HALF:
                raise ValueError(f"freshness {name} {value}: must be in {least}..{LARGEST_HALF}")

    @property
    def value(self) -> int:
        """As it is sent: 64 bits, the trip in the upper half."""
        return self.trip << 32 | self.count

    def next(self) -> Self:
        """The freshness of the next frame.

        After 2^32 frames, 2.7 years at 20 ms, it stays: receivers then refuse every frame, and the jets shut, until
        the power has been off once.
        """
        return type(self)(trip=self.trip, count=min(self.count + 1, LARGEST_HALF))
