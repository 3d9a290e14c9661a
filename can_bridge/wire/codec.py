"""The conversion of the CAN FD set's messages to data bytes and back, as defined in `contract/stillwake.dbc`.

`emit_*` returns the protected part of a message with an empty E2E header; `can_bridge.e2e` fills the header. `emit_*`
raises ValueError for a value that is not finite or out of range. `parse_*` reads the values, not the header. It returns
None for data of another length or a value outside the DBC's table, and never raises. Values are rounded to the nearest
multiple of the resolution. Bits without a signal are sent as zero and ignored when received.

`can_bridge.wire.classic_codec` also uses the tables and conversions whose names do not begin with an underscore.
"""

import math
import struct
from typing import Final

from can_bridge.wire import message_specs as specs
from can_bridge.wire import messages
from can_bridge.wire.messages import SENSORS, EcuStatus, JetCommand, Mode, Pressure, Reason, VehicleSpeed

# "3x" is the E2E header: CRC-16 and counter.
_PRESSURE: Final = struct.Struct("<3x B 4h H 2x")  # flags, pressures, age
_VEHICLE_SPEED: Final = struct.Struct("<3x B H H")  # density, speed, age
_JET_COMMAND: Final = struct.Struct("<3x B h B x")  # flags, flow, echoed counter
# The fields are state, reason, bus-off, overruns, missed, CRC errors, hash, refused, not authentic, transmit errors,
# receive errors, and pressures that the controller does not use.
_ECU_STATUS: Final = struct.Struct("<3x B B B H H H I H H B B B x")

# The bits of JetCommand's flags; bits 0 to 2 are the mode.
_ENABLE: Final = 1 << 3
_COUNTER_VALID: Final = 1 << 4
_NEXT_PERIOD: Final = 1 << 5

_STATUS_LIMITS: Final = {
    **dict.fromkeys(("EcuStatus.overruns", "EcuStatus.missed", "EcuStatus.crc_errors"), messages.COUNT_LIMIT),
    "EcuStatus.bus_off": messages.BUS_OFF_LIMIT,
    "EcuStatus.bundle_hash": 0xFFFFFFFF,
    **dict.fromkeys(("EcuStatus.refused", "EcuStatus.not_authentic"), messages.COUNT_LIMIT),
    **dict.fromkeys(("EcuStatus.tx_errors", "EcuStatus.rx_errors"), messages.ERROR_LIMIT),
    "EcuStatus.set_aside": messages.SET_ASIDE_LIMIT,
}
"""Largest values of the numbers in a status, in the order of `EcuStatus`."""

MODES: Final = {mode.value: mode for mode in Mode}
REASONS: Final = {reason.value: reason for reason in Reason}
"""Members of `Mode` and of `Reason`, by raw value."""


def emit_pressure(message: Pressure) -> bytes:
    """Return the message as 16 bytes; raises ValueError also for a wrong number of pressures."""
    steps = pressure_steps(message, specs.PRESSURE_RESOLUTION_PA, -specs.INT16_MAX - 1, specs.INT16_MAX)
    flags = sum(bool(one) << bit for bit, one in enumerate((*message.valid, message.enable_request)))
    return _PRESSURE.pack(flags, *steps, _age_steps("Pressure", message.age_ns))


def parse_pressure(data: bytes) -> Pressure | None:
    if len(data) != 16:
        return None
    flags, p0, p1, p2, p3, age = _PRESSURE.unpack(data)
    scale = specs.PRESSURE_RESOLUTION_PA
    return Pressure(
        pressure_pa=(p0 * scale, p1 * scale, p2 * scale, p3 * scale),
        valid=(flags & 1 != 0, flags & 2 != 0, flags & 4 != 0, flags & 8 != 0),
        enable_request=flags & 16 != 0,
        age_ns=age * specs.AGE_RESOLUTION_NS,
    )


def emit_vehicle_speed(message: VehicleSpeed) -> bytes:
    return _VEHICLE_SPEED.pack(*speed_steps(message), _age_steps("VehicleSpeed", message.age_ns))


def parse_vehicle_speed(data: bytes) -> VehicleSpeed | None:
    if len(data) != 8:
        return None
    density, speed, age = _VEHICLE_SPEED.unpack(data)
    return vehicle_speed(density, speed, age * specs.AGE_RESOLUTION_NS)


def emit_jet_command(message: JetCommand) -> bytes:
    flow, mode, enable, counter, next_period = message
    flags = Mode(mode) | (_ENABLE if enable else 0) | (_NEXT_PERIOD if next_period else 0)
    flags |= 0 if counter is None else _COUNTER_VALID
    return _JET_COMMAND.pack(flags, flow_steps(flow), unsigned("JetCommand.pressure_counter", counter or 0, 0xFF))


def parse_jet_command(data: bytes) -> JetCommand | None:
    if len(data) != 8:
        return None
    flags, flow, counter = _JET_COMMAND.unpack(data)
    if (mode := MODES.get(flags & 0b111)) is None:
        return None
    return JetCommand(
        flow_m2_per_s=flow * specs.FLOW_RESOLUTION_M2_PER_S,
        mode=mode,
        enable=bool(flags & _ENABLE),
        pressure_counter=counter if flags & _COUNTER_VALID else None,
        next_period=bool(flags & _NEXT_PERIOD),
    )


def emit_ecu_status(message: EcuStatus) -> bytes:
    state, reason, *values = message
    for (name, most), value in zip(_STATUS_LIMITS.items(), values, strict=True):
        unsigned(name, value, most)
    overruns, missed, crc_errors, bus_off, *rest = values
    return _ECU_STATUS.pack(Mode(state), Reason(reason), bus_off, overruns, missed, crc_errors, *rest)


def parse_ecu_status(data: bytes) -> EcuStatus | None:
    if len(data) != 24:
        return None
    raw_state, raw_reason, bus_off, overruns, missed, crc_errors, *rest, aside = _ECU_STATUS.unpack(data)
    state, reason = MODES.get(raw_state & 0b1111), REASONS.get(raw_reason)
    if state is None or reason is None:
        return None
    counts = overruns, missed, crc_errors, bus_off, *rest, aside & messages.SET_ASIDE_LIMIT
    return EcuStatus._make((state, reason, *counts))


def _age_steps(message: str, age_ns: int) -> int:
    # The division rounds half up. It uses integers because ages are exact numbers of ns.
    steps = (age_ns + specs.AGE_RESOLUTION_NS // 2) // specs.AGE_RESOLUTION_NS
    if not 0 <= steps <= 0xFFFF:
        raise ValueError(f"{message}.age_ns = {age_ns}: must be in 0..{0xFFFF * specs.AGE_RESOLUTION_NS}")
    return steps


def pressure_steps(message: Pressure, resolution_pa: float, low: int, high: int) -> list[int]:
    """Return the pressures' raw values. Raises ValueError as `signed` does, or for a wrong number of values."""
    for name, values in (("pressure_pa", message.pressure_pa), ("valid", message.valid)):
        if len(values) != SENSORS:
            raise ValueError(f"Pressure.{name} has {len(values)} values: must have {SENSORS}")
    return [signed("Pressure.pressure_pa", value, resolution_pa, low, high) for value in message.pressure_pa]


def flow_steps(flow_m2_per_s: float) -> int:
    """Return the raw value of a flow; raises ValueError as `signed` does."""
    low, high = -specs.INT16_MAX - 1, specs.INT16_MAX
    return signed("JetCommand.flow_m2_per_s", flow_m2_per_s, specs.FLOW_RESOLUTION_M2_PER_S, low, high)


def speed_steps(message: VehicleSpeed) -> tuple[int, int]:
    """Return the raw values of density and speed; raises ValueError as `signed` does."""
    speed, _, density = message
    density_steps, steps = specs.DENSITY_UNKNOWN, specs.SPEED_UNKNOWN
    if density is not None:
        name, resolution = "VehicleSpeed.density_kg_per_m3", specs.DENSITY_RESOLUTION_KG_PER_M3
        density_steps = signed(name, density, resolution, specs.DENSITY_UNKNOWN + 1, 0xFF)
    if speed is not None:
        name, resolution = "VehicleSpeed.speed_m_per_s", specs.SPEED_RESOLUTION_M_PER_S
        steps = signed(name, speed, resolution, 0, specs.SPEED_UNKNOWN - 1)
    return density_steps, steps


def vehicle_speed(density: int, speed: int, age_ns: int) -> VehicleSpeed:
    return VehicleSpeed(
        speed_m_per_s=None if speed == specs.SPEED_UNKNOWN else speed * specs.SPEED_RESOLUTION_M_PER_S,
        age_ns=age_ns,
        density_kg_per_m3=None if density == specs.DENSITY_UNKNOWN else density * specs.DENSITY_RESOLUTION_KG_PER_M3,
    )


def signed(name: str, value: float, resolution: float, low: int, high: int) -> int:
    """Return the raw value nearest to `value`. Raises ValueError if this is not finite, or not in `low` to `high`."""
    # The quotient of a very large value is infinite, and cannot be rounded to an integer.
    steps = value / resolution
    if math.isfinite(steps) and low <= round(steps) <= high:
        return round(steps)
    must = f"in {low * resolution:g}..{high * resolution:g}" if math.isfinite(value) else "finite"
    raise ValueError(f"{name} = {value}: must be {must}")


def unsigned(name: str, value: int, largest: int) -> int:
    """Return the value; raises ValueError if it is not in 0..largest."""
    if not 0 <= value <= largest:
        raise ValueError(f"{name} = {value}: must be in 0..{largest}")
    return value
