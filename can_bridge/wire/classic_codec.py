"""The messages of the classic set: eight bytes each, for a bus or a controller without CAN FD.

The codec works as `can_bridge.wire.codec` does, within the limits of eight bytes:

- A pressure has 12 bits with a resolution of 1 Pa, and no validity bit; -2048 means that the sensor reports a fault.
- An age is in units of 10 ms, rounded up, so that no frame looks fresher than it is. The largest value (70 ms or more)
  is read as `STALE_NS`, which is too old for any use. The age of a speed is sent as 2.55 s if it is greater.
- A status has counts up to 63 (bus-off: 15) and two bytes of the bundle hash. It has no error counters, no list of
  unused pressures, and no count of frames that are not authentic, because this set has no authentication.

A message is one little-endian number, in which each field begins at the bit that the DBC states.
"""

from typing import Final

from can_bridge.wire import message_specs as specs
from can_bridge.wire.codec import MODES, REASONS, flow_steps, pressure_steps, speed_steps, unsigned, vehicle_speed
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Pressure, Reason, VehicleSpeed

_LENGTH: Final = 8

STALE_NS: Final = 1_000_000_000
"""Age in ns that is read from a frame of the classic set whose age field means 70 ms or more."""

CLASSIC_COUNT_LIMIT: Final = 63
CLASSIC_BUS_OFF_LIMIT: Final = 15

_AGE_LIMIT: Final = 7
_INVALID: Final = -specs.INT12_MAX - 1
_PRESSURE_BITS: Final = (16, 28, 40, 52)  # where the pressures begin


def emit_pressure(message: Pressure) -> bytes:
    """Return the message as 8 bytes; raises ValueError for invalid values or a wrong number of pressures."""
    steps = pressure_steps(message, specs.CLASSIC_PRESSURE_RESOLUTION_PA, -specs.INT12_MAX, specs.INT12_MAX)
    number = bool(message.enable_request) << 12 | _age_steps("Pressure", message.age_ns, _AGE_LIMIT) << 13
    for begin, step, valid in zip(_PRESSURE_BITS, steps, message.valid, strict=True):
        number |= ((step if valid else _INVALID) & 0xFFF) << begin
    return number.to_bytes(_LENGTH, "little")


def parse_pressure(data: bytes) -> Pressure | None:
    """Decode a Pressure from 8 bytes; return None for another length. The pressure of an invalid sensor is 0."""
    if len(data) != _LENGTH:
        return None
    number = int.from_bytes(data, "little")
    steps = [_signed(number >> begin & 0xFFF, 12) for begin in _PRESSURE_BITS]
    age = number >> 13 & _AGE_LIMIT
    return Pressure(
        pressure_pa=tuple(0.0 if step == _INVALID else step * specs.CLASSIC_PRESSURE_RESOLUTION_PA for step in steps),
        valid=tuple(step != _INVALID for step in steps),
        enable_request=bool(number >> 12 & 1),
        age_ns=STALE_NS if age == _AGE_LIMIT else age * specs.CLASSIC_AGE_RESOLUTION_NS,
    )


def emit_vehicle_speed(message: VehicleSpeed) -> bytes:
    density, speed = speed_steps(message)
    age = _age_steps("VehicleSpeed", message.age_ns, 0xFF)
    return (density << 24 | speed << 32 | age << 48).to_bytes(_LENGTH, "little")


def parse_vehicle_speed(data: bytes) -> VehicleSpeed | None:
    if len(data) != _LENGTH:
        return None
    return vehicle_speed(data[3], int.from_bytes(data[4:6], "little"), data[6] * specs.CLASSIC_AGE_RESOLUTION_NS)


def emit_jet_command(message: JetCommand) -> bytes:
    flow, mode, enable, counter, next_period = message
    number = Mode(mode) << 12 | bool(enable) << 15 | (flow_steps(flow) & 0xFFFF) << 16
    number |= (counter is not None) << 32 | bool(next_period) << 33
    number |= unsigned("JetCommand.pressure_counter", counter or 0, 0xF) << 36
    return number.to_bytes(_LENGTH, "little")


def parse_jet_command(data: bytes) -> JetCommand | None:
    if len(data) != _LENGTH:
        return None
    number = int.from_bytes(data, "little")
    if (mode := MODES.get(number >> 12 & 0b111)) is None:
        return None
    return JetCommand(
        flow_m2_per_s=_signed(number >> 16 & 0xFFFF, 16) * specs.FLOW_RESOLUTION_M2_PER_S,
        mode=mode,
        enable=bool(number >> 15 & 1),
        pressure_counter=number >> 36 & 0xF if number >> 32 & 1 else None,
        next_period=bool(number >> 33 & 1),
    )


def emit_ecu_status(message: EcuStatus) -> bytes:
    """Return the message as 8 bytes; a count above its field's largest value is sent as this value."""
    number = Mode(message.state) << 12 | Reason(message.reason) << 15
    counts = (("overruns", 24), ("missed", 30), ("crc_errors", 36), ("refused", 42), ("bus_off", 20))
    for name, begin in counts:
        if (count := getattr(message, name)) < 0:
            raise ValueError(f"EcuStatus.{name} = {count}: must not be negative")
        number |= min(count, CLASSIC_BUS_OFF_LIMIT if name == "bus_off" else CLASSIC_COUNT_LIMIT) << begin
    number |= unsigned("EcuStatus.bundle_hash", message.bundle_hash, 0xFFFFFFFF) >> 16 << 48
    return number.to_bytes(_LENGTH, "little")


def parse_ecu_status(data: bytes) -> EcuStatus | None:
    """Decode an EcuStatus from 8 bytes; None for another length, state or reason. Half of the hash is 0: not sent."""
    if len(data) != _LENGTH:
        return None
    number = int.from_bytes(data, "little")
    state, reason = MODES.get(number >> 12 & 0b111), REASONS.get(number >> 15 & 0b11111)
    if state is None or reason is None:
        return None
    return EcuStatus(
        state=state,
        reason=reason,
        overruns=number >> 24 & CLASSIC_COUNT_LIMIT,
        missed=number >> 30 & CLASSIC_COUNT_LIMIT,
        crc_errors=number >> 36 & CLASSIC_COUNT_LIMIT,
        bus_off=number >> 20 & CLASSIC_BUS_OFF_LIMIT,
        bundle_hash=number >> 48 << 16,
        refused=number >> 42 & CLASSIC_COUNT_LIMIT,
    )


def _signed(raw: int, bits: int) -> int:
    return raw - (raw >> bits - 1 << bits)


def _age_steps(message: str, age_ns: int, most: int) -> int:
    if age_ns < 0:
        raise ValueError(f"{message}.age_ns = {age_ns}: must not be negative")
    return min(-(-age_ns // specs.CLASSIC_AGE_RESOLUTION_NS), most)
