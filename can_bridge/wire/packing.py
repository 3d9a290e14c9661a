"""Numbers to the integers of the wire, and what is refused on the way."""

import math


def signed(name: str, value: float, resolution: float, low: int, high: int) -> int:
    """The nearest step of the wire; raises ValueError if it is beyond `low` or `high` steps, or there is none."""
    if not math.isfinite(value):
        raise ValueError(f"{name} = {value}: must be finite")
    # Of a huge value the quotient is infinite, and infinity has no nearest whole number.
    steps = value / resolution
    if not (math.isfinite(steps) and low <= round(steps) <= high):
        raise ValueError(f"{name} = {value}: must be in {low * resolution:g}..{high * resolution:g}")
    return round(steps)


def unsigned(name: str, value: int, largest: int) -> int:
    """The value itself; raises ValueError if it is not in 0..largest."""
    if not 0 <= value <= largest:
        raise ValueError(f"{name} = {value}: must be in 0..{largest}")
    return value
