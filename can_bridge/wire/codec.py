"""The conversion of the CAN FD set's messages to data bytes and back, as defined in `contract/stillwake.dbc`.

`emit_*` returns the protected part of a message with an empty E2E header; `can_bridge.e2e` fills the header. `emit_*`
raises ValueError for a value that is not finite or out of range. `parse_*` reads the values, not the header. It returns
None for data of another length or a value outside the DBC's table, and never raises. Values are rounded to the nearest
multiple of the resolution. Bits without a signal are sent as zero and ignored when received.

These functions run for every frame, so `emit_*` searches for the invalid value only after packing has failed. The
tables and conversions without an underscore also serve `can_bridge.wire.classic_codec`.
"""

import math
import struct
from itertools import product
from typing import Final

from can_bridge.wire import messages
from can_bridge.wire.message_specs import (
    AGE_RESOLUTION_NS,
    DENSITY_RESOLUTION_KG_PER_M3,
    DENSITY_UNKNOWN,
    FLOW_RESOLUTION_M2_PER_S,
    INT16_MAX,
    PRESSURE_RESOLUTION_PA,
    SPEED_RESOLUTION_M_PER_S,
    SPEED_UNKNOWN,
)
from can_bridge.wire.messages import SENSORS, EcuStatus, JetCommand, Mode, Pressure, Reason, VehicleSpeed

# "3x" is the E2E header: CRC-16 and counter.
_PRESSURE: Final = struct.Struct("<3x B 4h H 2x")  # flags, pressures, age
_VEHICLE_SPEED: Final = struct.Struct("<3x B H H")  # density, speed, age
_JET_COMMAND: Final = struct.Struct("<3x B h B x")  # flags, flow, echoed counter
# The fields are state, reason, bus-off, overruns, missed, CRC errors, hash, refused, not authentic, transmit errors,
# receive errors, and pressures that the controller does not use.
_ECU_STATUS: Final = struct.Struct("<3x B B B H H H I H H B B B x")

_VALID: Final = 0b1111
_ENABLE_REQUEST: Final = 1 << 4

_MODE_MASK: Final = 0b111
_ENABLE: Final = 1 << 3
_COUNTER_VALID: Final = 1 << 4
_NEXT_PERIOD: Final = 1 << 5

_STATE_MASK: Final = 0b1111

UNPACKABLE: Final = (ValueError, OverflowError, TypeError, struct.error)
"""Exceptions that packing or rounding raises for a value out of range."""

made: Final = tuple.__new__
"""A function that builds a named tuple from all of its values in order. Calling the named tuple's own constructor would
take a sixth of a parser's time."""

_BYTE: Final = range(256)
MODES: Final = tuple(Mode(value) if value in frozenset(Mode) else None for value in _BYTE)
REASONS: Final = tuple(Reason(value) if value in frozenset(Reason) else None for value in _BYTE)
"""Members by raw value; None for a value outside the DBC's table. This look-up is faster than a call of the enum."""

_VALIDITIES: Final = tuple(bits[::-1] for bits in product((False, True), repeat=SENSORS))
"""Validity flags of the sensors, by the raw value of their bits."""


def emit_pressure(message: Pressure) -> bytes:
    """Return the message as 16 bytes; raises ValueError also for a wrong number of pressures."""
    pressure_pa, valid, enable_request, age_ns = message
    try:
        p0, p1, p2, p3 = pressure_pa
        v0, v1, v2, v3 = valid
        flags = bool(v0) | bool(v1) << 1 | bool(v2) << 2 | bool(v3) << 3
        return _PRESSURE.pack(
            flags | _ENABLE_REQUEST if enable_request else flags,
            round(p0 / PRESSURE_RESOLUTION_PA),
            round(p1 / PRESSURE_RESOLUTION_PA),
            round(p2 / PRESSURE_RESOLUTION_PA),
            round(p3 / PRESSURE_RESOLUTION_PA),
            _age_steps(age_ns),
        )
    except UNPACKABLE:
        check_pressure_counts(message)
        for value in pressure_pa:
            signed("Pressure.pressure_pa", value, PRESSURE_RESOLUTION_PA, -INT16_MAX - 1, INT16_MAX)
        raise _age_error("Pressure", age_ns) from None


def parse_pressure(data: bytes) -> Pressure | None:
    """Return the message in 16 bytes."""
    if len(data) != 16:
        return None
    flags, p0, p1, p2, p3, age = _PRESSURE.unpack(data)
    scale = PRESSURE_RESOLUTION_PA
    return made(
        Pressure,
        (
            (p0 * scale, p1 * scale, p2 * scale, p3 * scale),
            _VALIDITIES[flags & _VALID],
            flags & _ENABLE_REQUEST != 0,
            age * AGE_RESOLUTION_NS,
        ),
    )


def emit_vehicle_speed(message: VehicleSpeed) -> bytes:
    """Return the message as 8 bytes."""
    density, speed = speed_steps(message)
    try:
        return _VEHICLE_SPEED.pack(density, speed, _age_steps(message.age_ns))
    except UNPACKABLE:
        raise _age_error("VehicleSpeed", message.age_ns) from None


def parse_vehicle_speed(data: bytes) -> VehicleSpeed | None:
    """Return the message in 8 bytes."""
    if len(data) != 8:
        return None
    density, speed, age = _VEHICLE_SPEED.unpack(data)
    return vehicle_speed(density, speed, age * AGE_RESOLUTION_NS)


def emit_jet_command(message: JetCommand) -> bytes:
    """Return the message as 8 bytes."""
    flow, mode, enable, counter, next_period = message
    try:
        flags = mode_of(mode) | (_ENABLE if enable else 0) | (_NEXT_PERIOD if next_period else 0)
        if counter is None:
            return _JET_COMMAND.pack(flags, round(flow / FLOW_RESOLUTION_M2_PER_S), 0)
        return _JET_COMMAND.pack(flags | _COUNTER_VALID, round(flow / FLOW_RESOLUTION_M2_PER_S), counter)
    except UNPACKABLE:
        Mode(mode)
        signed("JetCommand.flow_m2_per_s", flow, FLOW_RESOLUTION_M2_PER_S, -INT16_MAX - 1, INT16_MAX)
        raise ValueError(f"JetCommand.pressure_counter = {counter}: must be in 0..255") from None


def parse_jet_command(data: bytes) -> JetCommand | None:
    """Return the message in 8 bytes."""
    if len(data) != 8:
        return None
    flags, flow, counter = _JET_COMMAND.unpack(data)
    mode = MODES[flags & _MODE_MASK]
    if mode is None:
        return None
    echoed, enable, next_period = counter if flags & _COUNTER_VALID else None, flags & _ENABLE, flags & _NEXT_PERIOD
    return made(JetCommand, (flow * FLOW_RESOLUTION_M2_PER_S, mode, enable != 0, echoed, next_period != 0))


def emit_ecu_status(message: EcuStatus) -> bytes:
    """Return the message as 24 bytes."""
    state, reason, overruns, missed, crc, bus_off, bundle_hash, refused, forged, tx, rx, aside = message
    if not 0 <= aside <= messages.SET_ASIDE_LIMIT:
        aside = -1  # packing fails, because no byte holds this value
    try:
        counts = bus_off, overruns, missed, crc, bundle_hash, refused, forged, tx, rx, aside
        return _ECU_STATUS.pack(mode_of(state), reason_of(reason), *counts)
    except UNPACKABLE:
        limits = {
            "bus_off": messages.BUS_OFF_LIMIT,
            "bundle_hash": 0xFFFFFFFF,
            "tx_errors": messages.ERROR_LIMIT,
            "rx_errors": messages.ERROR_LIMIT,
            "set_aside": messages.SET_ASIDE_LIMIT,
        }
        for name in message._fields[2:]:
            unsigned(f"EcuStatus.{name}", getattr(message, name), limits.get(name, messages.COUNT_LIMIT))
        raise


def parse_ecu_status(data: bytes) -> EcuStatus | None:
    """Return the message in 24 bytes."""
    if len(data) != 24:
        return None
    state, reason, bus_off, overruns, missed, crc, *rest, aside = _ECU_STATUS.unpack(data)
    known_state, known_reason = MODES[state & _STATE_MASK], REASONS[reason]
    if known_state is None or known_reason is None:
        return None
    counts = overruns, missed, crc, bus_off, *rest
    return made(EcuStatus, (known_state, known_reason, *counts, aside & messages.SET_ASIDE_LIMIT))


def _age_steps(age_ns: int) -> int:
    # The division rounds half up. It uses integers because ages are exact numbers of ns.
    return (age_ns + AGE_RESOLUTION_NS // 2) // AGE_RESOLUTION_NS


def _age_error(message: str, age_ns: int) -> ValueError:
    return ValueError(f"{message}.age_ns = {age_ns}: must be in 0..{0xFFFF * AGE_RESOLUTION_NS}")


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
