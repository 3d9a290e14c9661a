"""Common parts of the codecs: conversion of values to a frame's integers, tables, and errors for invalid values."""

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
"""Exceptions of packing or rounding for a value out of range."""

made: Final = tuple.__new__
"""A function that builds a named tuple from all of its values in order. Calling the named tuple's own constructor would
take a sixth of a parser's time."""

_BYTE: Final = range(256)
MODES: Final = tuple(Mode(value) if value in frozenset(Mode) else None for value in _BYTE)
REASONS: Final = tuple(Reason(value) if value in frozenset(Reason) else None for value in _BYTE)
"""Members by raw value; None for a value outside the DBC's table. This look-up is faster than a call of the enum."""

VALIDITIES: Final = tuple(bits[::-1] for bits in product((False, True), repeat=SENSORS))
"""Validity flags of the sensors, by the raw value of their bits."""


def mode_of(mode: Mode) -> Mode:
    """Return the mode; raises ValueError for another number."""
    return mode if mode.__class__ is Mode else Mode(mode)


def reason_of(reason: Reason) -> Reason:
    """Return the reason; raises ValueError for another number."""
    return reason if reason.__class__ is Reason else Reason(reason)


def check_pressure_counts(message: Pressure) -> None:
    """Raise ValueError unless the message has a pressure and a validity for each sensor."""
    for name, values in (("pressure_pa", message.pressure_pa), ("valid", message.valid)):
        if len(values) != SENSORS:
            raise ValueError(f"Pressure.{name} has {len(values)} values: must have {SENSORS}")


def speed_steps(message: VehicleSpeed) -> tuple[int, int]:
    """Return the raw values of density and speed; raises ValueError as `signed` does."""
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
    """Return the message with these raw values of density and speed."""
    return made(
        VehicleSpeed,
        (
            None if speed == SPEED_UNKNOWN else speed * SPEED_RESOLUTION_M_PER_S,
            age_ns,
            None if density == DENSITY_UNKNOWN else density * DENSITY_RESOLUTION_KG_PER_M3,
        ),
    )


def signed(name: str, value: float, resolution: float, low: int, high: int) -> int:
    """Return the raw value nearest to `value`; raises ValueError if it is not finite or not in `low` to `high`."""
    if not math.isfinite(value):
        raise ValueError(f"{name} = {value}: must be finite")
    # The quotient of a very large value is infinite, and cannot be rounded to an integer.
    steps = value / resolution
    if not (math.isfinite(steps) and low <= round(steps) <= high):
        raise ValueError(f"{name} = {value}: must be in {low * resolution:g}..{high * resolution:g}")
    return round(steps)


def unsigned(name: str, value: int, largest: int) -> int:
    """Return the value; raises ValueError if it is not in 0..largest."""
    if not 0 <= value <= largest:
        raise ValueError(f"{name} = {value}: must be in 0..{largest}")
    return value
