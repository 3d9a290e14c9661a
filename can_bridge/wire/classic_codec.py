"""The messages of the classic set: eight bytes each, for a bus or a controller without CAN FD.

The codec works as `can_bridge.wire.codec` does, within the limits of eight bytes:

- A pressure has 12 bits of 1 Pa. There are no validity bits; -2048 means that the sensor's diagnosis found a fault.
- An age is in units of 10 ms, rounded up, so that no frame looks fresher than it is. The largest value (70 ms or more)
  is read as `STALE_NS`, which is too old for any use. The age of a speed is sent as 2.55 s if it is greater.
- A status has counts up to 63 (bus-off: 15) and two bytes of the bundle hash. It has no error counters, no list of
  unused pressures, and no count of frames that are not authentic, because this set has no authentication.
"""

import struct
from typing import Final

from can_bridge.wire.codec import (
    MODES,
    REASONS,
    UNPACKABLE,
    check_pressure_counts,
    made,
    mode_of,
    reason_of,
    signed,
    speed_steps,
    unsigned,
    vehicle_speed,
)
from can_bridge.wire.message_specs import (
    CLASSIC_AGE_RESOLUTION_NS,
    CLASSIC_PRESSURE_RESOLUTION_PA,
    FLOW_RESOLUTION_M2_PER_S,
    INT12_MAX,
    INT16_MAX,
)
from can_bridge.wire.messages import EcuStatus, JetCommand, Pressure, VehicleSpeed

_LENGTH: Final = 8

STALE_NS: Final = 1_000_000_000
"""Age in ns that is read from a frame of the classic set whose age field means 70 ms or more."""

CLASSIC_COUNT_LIMIT: Final = 63
CLASSIC_BUS_OFF_LIMIT: Final = 15

_AGE_LIMIT: Final = 7
_SPEED_AGE_LIMIT: Final = 0xFF
_INVALID: Final = -INT12_MAX - 1
_INVALID_FIELD: Final = _INVALID & 0xFFF
_ALL_VALID: Final = (True, True, True, True)
_NEXT_PERIOD: Final = 1 << 1

# "x" is the CRC; the next byte holds the counter and other bits. A field that spans several bytes is combined from
# pieces, because arithmetic on numbers of one machine word is faster than on numbers of 64 bits.
_PRESSURE: Final = struct.Struct("<x B 3H")  # request and age, pressures
_VEHICLE_SPEED: Final = struct.Struct("<3x B H B x")  # density, speed, age
_JET_COMMAND: Final = struct.Struct("<x B h B 3x")  # mode and enable, flow, echo and next period
_ECU_STATUS: Final = struct.Struct("<x B B H B H")  # state and a bit of the reason, the rest and bus-off, counts, hash

# Look-up tables, from a pressure to the field's bits and back, are faster than arithmetic.
_FIELDS: Final = {raw: raw & 0xFFF for raw in range(-INT12_MAX, INT12_MAX + 1)}
_PASCALS: Final = tuple(
    (raw - 0x1000 if raw & 0x800 else raw) * CLASSIC_PRESSURE_RESOLUTION_PA if raw != _INVALID_FIELD else 0.0
    for raw in range(0x1000)
)
_AGES_NS: Final = (*(step * CLASSIC_AGE_RESOLUTION_NS for step in range(_AGE_LIMIT)), STALE_NS)


def emit_pressure(message: Pressure) -> bytes:
    """Return the message as 8 bytes; raises ValueError for invalid values or a wrong number of pressures."""
    pressure_pa, valid, enable_request, age_ns = message
    try:
        p0, p1, p2, p3 = pressure_pa
        v0, v1, v2, v3 = valid
        # The resolution is 1 Pa, so the pressures need no division.
        f0, f1, f2, f3 = _FIELDS[round(p0)], _FIELDS[round(p1)], _FIELDS[round(p2)], _FIELDS[round(p3)]
        if age_ns < 0:
            raise ValueError
    except (*UNPACKABLE, KeyError):
        check_pressure_counts(message)
        for value in pressure_pa:
            signed("Pressure.pressure_pa", value, CLASSIC_PRESSURE_RESOLUTION_PA, -INT12_MAX, INT12_MAX)
        raise ValueError(f"Pressure.age_ns = {age_ns}: must not be negative") from None
    if not (v0 and v1 and v2 and v3):
        f0, f1, f2, f3 = (f if v else _INVALID_FIELD for f, v in zip((f0, f1, f2, f3), valid, strict=True))
    age = -(-age_ns // CLASSIC_AGE_RESOLUTION_NS)
    return _PRESSURE.pack(
        (0x10 if enable_request else 0) | (age if age < _AGE_LIMIT else _AGE_LIMIT) << 5,
        f0 | (f1 & 0xF) << 12,
        f1 >> 4 | (f2 & 0xFF) << 8,
        f2 >> 8 | f3 << 4,
    )


def parse_pressure(data: bytes) -> Pressure | None:
    """Return the message in 8 bytes. The pressure of a sensor that is not valid is 0."""
    if len(data) != _LENGTH:
        return None
    head, a, b, c = _PRESSURE.unpack(data)
    f0, f1, f2, f3 = fields = (a & 0xFFF, a >> 12 | (b & 0xFF) << 4, b >> 8 | (c & 0xF) << 8, c >> 4)
    return made(
        Pressure,
        (
            (_PASCALS[f0], _PASCALS[f1], _PASCALS[f2], _PASCALS[f3]),
            tuple(field != _INVALID_FIELD for field in fields) if _INVALID_FIELD in fields else _ALL_VALID,
            head & 0x10 != 0,
            _AGES_NS[head >> 5],
        ),
    )


def emit_vehicle_speed(message: VehicleSpeed) -> bytes:
    """Return the message as 8 bytes. Raises ValueError for a value not finite or out of range; no age is too great."""
    density, speed = speed_steps(message)
    if message.age_ns < 0:
        raise ValueError(f"VehicleSpeed.age_ns = {message.age_ns}: must not be negative")
    age = -(-message.age_ns // CLASSIC_AGE_RESOLUTION_NS)
    return _VEHICLE_SPEED.pack(density, speed, age if age < _SPEED_AGE_LIMIT else _SPEED_AGE_LIMIT)


def parse_vehicle_speed(data: bytes) -> VehicleSpeed | None:
    """Return the message in 8 bytes, or None for another length."""
    if len(data) != _LENGTH:
        return None
    density, speed, age = _VEHICLE_SPEED.unpack(data)
    return vehicle_speed(density, speed, age * CLASSIC_AGE_RESOLUTION_NS)


def emit_jet_command(message: JetCommand) -> bytes:
    """Return the message as 8 bytes."""
    flow, mode, enable, counter, next_period = message
    try:
        head = mode_of(mode) << 4 | (0x80 if enable else 0)
        echo = 0 if counter is None else 1 | unsigned("JetCommand.pressure_counter", counter, 0xF) << 4
        echo |= _NEXT_PERIOD if next_period else 0
        return _JET_COMMAND.pack(head, round(flow / FLOW_RESOLUTION_M2_PER_S), echo)
    except UNPACKABLE:
        signed("JetCommand.flow_m2_per_s", flow, FLOW_RESOLUTION_M2_PER_S, -INT16_MAX - 1, INT16_MAX)
        raise


def parse_jet_command(data: bytes) -> JetCommand | None:
    """Return the message in 8 bytes, or None for another length or a mode outside the DBC's table."""
    if len(data) != _LENGTH:
        return None
    head, flow, echo = _JET_COMMAND.unpack(data)
    mode = MODES[head >> 4 & 0b111]
    if mode is None:
        return None
    echoed = echo >> 4 if echo & 1 else None
    return made(JetCommand, (flow * FLOW_RESOLUTION_M2_PER_S, mode, head & 0x80 != 0, echoed, echo & _NEXT_PERIOD != 0))


def emit_ecu_status(message: EcuStatus) -> bytes:
    """Return the message as 8 bytes; a count above its field's largest value is sent as this value."""
    state, reason, overruns, missed, crc_errors, bus_off, bundle_hash, refused, *_ = message
    if min(overruns, missed, crc_errors, refused, bus_off) < 0:
        counts = ("overruns", "missed", "crc_errors", "bus_off", "refused")
        name = next(name for name in counts if getattr(message, name) < 0)
        raise ValueError(f"EcuStatus.{name} = {getattr(message, name)}: must not be negative")
    most = CLASSIC_COUNT_LIMIT
    crc_errors = crc_errors if crc_errors < most else most
    return _ECU_STATUS.pack(
        mode_of(state) << 4 | (reason_of(reason) & 1) << 7,
        reason >> 1 | (bus_off if bus_off < CLASSIC_BUS_OFF_LIMIT else CLASSIC_BUS_OFF_LIMIT) << 4,
        (overruns if overruns < most else most) | (missed if missed < most else most) << 6 | (crc_errors & 0xF) << 12,
        crc_errors >> 4 | (refused if refused < most else most) << 2,
        unsigned("EcuStatus.bundle_hash", bundle_hash, 0xFFFFFFFF) >> 16,
    )


def parse_ecu_status(data: bytes) -> EcuStatus | None:
    """Return the message in 8 bytes. The lower half of the bundle's hash is 0, because this half is not sent."""
    if len(data) != _LENGTH:
        return None
    head, why, low, high, bundle_hash = _ECU_STATUS.unpack(data)
    state, reason = MODES[head >> 4 & 0b111], REASONS[head >> 7 | (why & 0xF) << 1]
    if state is None or reason is None:
        return None
    overruns, missed = low & 0x3F, low >> 6 & 0x3F
    crc_errors, refused, bus_off = low >> 12 | (high & 0b11) << 4, high >> 2, why >> 4
    return made(
        EcuStatus, (state, reason, overruns, missed, crc_errors, bus_off, bundle_hash << 16, refused, 0, 0, 0, 0)
    )
