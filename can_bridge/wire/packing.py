"""What the codecs share: numbers to the integers of the wire, the tables, and what is refused on the way."""

import math
import struct
from itertools import product
from typing import Final

from can_bridge.wire.message_specs import (
    DENSITY_RESOLUTION_KG_PER_M3,
    DENSITY_UNKNOWN,
    SPEED_RESOLUTION_M_PER_S,
    SPEED_UNKNOWN,
)
from can_bridge.wire.messages import SENSORS, Mode, Pressure, Reason, VehicleSpeed

UNPACKABLE: Final = (ValueError, OverflowError, TypeError, struct.error)
"""What packing or rounding raises for a value that the wire cannot carry."""

made: Final = tuple.__new__
"""A named tuple from all of its values in order: without the Python function that takes them by name, which costs a
sixth of a parser's time. Types are not checked: the parsers' tests are."""

_BYTE: Final = range(256)
MODES: Final = tuple(Mode(value) if value in frozenset(Mode) else None for value in _BYTE)
REASONS: Final = tuple(Reason(value) if value in frozenset(Reason) else None for value in _BYTE)
"""Members by the value on the wire; None for one that is not in the DBC's table. Looking up is faster than building an
enum."""

VALIDITIES: Final = tuple(bits[::-1] for bits in product((False, True), repeat=SENSORS))
"""Valid flags of the sensors, by their bits on the wire."""


def mode_of(mode: Mode) -> Mode:
    """The mode itself; raises ValueError for a number that is none."""
    return mode if mode.__class__ is Mode else Mode(mode)


def reason_of(reason: Reason) -> Reason:
    """The reason itself; raises ValueError for a number that is none."""
    return reason if reason.__class__ is Reason else Reason(reason)


def check_pressure_counts(message: Pressure) -> None:
    """Raises ValueError unless there is a pressure and a validity for each sensor of the wire."""
    for name, values in (("pressure_pa", message.pressure_pa), ("valid", message.valid)):
        if len(values) != SENSORS:
            raise ValueError(f"Pressure.{name} has {len(values)} values: must have {SENSORS}")


def speed_steps(message: VehicleSpeed) -> tuple[int, int]:
    """Density and speed in steps of the wire; raises ValueError for one that is not finite or out of its range."""
    speed, _, density = message
    most = SPEED_UNKNOWN - 1
    return (
        DENSITY_UNKNOWN
        if density is None
        else signed("VehicleSpeed.density_kg_per_m3", density, DENSITY_RESOLUTION_KG_PER_M3, DENSITY_UNKNOWN + 1, 0xFF),
        SPEED_UNKNOWN
        if speed is None
        else signed("VehicleSpeed.speed_m_per_s", speed, SPEED_RESOLUTION_M_PER_S, 0, most),
    )


def vehicle_speed(density: int, speed: int, age_ns: int) -> VehicleSpeed:
    """The message from density and speed in steps of the wire."""
    return made(
        VehicleSpeed,
        (
            None if speed == SPEED_UNKNOWN else speed * SPEED_RESOLUTION_M_PER_S,
            age_ns,
            None if density == DENSITY_UNKNOWN else density * DENSITY_RESOLUTION_KG_PER_M3,
        ),
    )


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
