"""The messages of the classic set: eight bytes each, for a bus or a controller without CAN FD.

Like `can_bridge.wire.codec`, with what eight bytes cost:

- pressures of 12 bits in whole Pa, -2048 where the sensor's own diagnosis failed (there are no validity bits);
- an age in steps of 10 ms, rounded up, so that no frame looks fresher than it is; the last step, 70 ms or more, is
  read as `STALE_NS`, on which nothing may rest;
- a status whose counts stay at 63, whose bundle hash has two bytes, and that has no count of frames that are not
  authentic (this set has no authentication) and no error counters.
"""

from typing import Final

from can_bridge.wire.message_specs import (
    CLASSIC_AGE_RESOLUTION_NS,
    CLASSIC_PRESSURE_RESOLUTION_PA,
    FLOW_RESOLUTION_M2_PER_S,
    INT12_MAX,
    INT16_MAX,
)
from can_bridge.wire.messages import SENSORS, EcuStatus, JetCommand, Mode, Pressure, Reason
from can_bridge.wire.packing import signed, unsigned

LENGTH: Final = 8

STALE_NS: Final = 1_000_000_000
"""What an age of 70 ms or more is read as."""

CLASSIC_COUNT_LIMIT: Final = 63
CLASSIC_BUS_OFF_LIMIT: Final = 15

_AGE_LIMIT: Final = 7
_INVALID: Final = -INT12_MAX - 1

_MODES: Final = frozenset(Mode)
_REASONS: Final = frozenset(Reason)


def emit_pressure(message: Pressure) -> bytes:
    """8 bytes. Raises ValueError for a wrong count, a value that is not finite or out of the wire's range."""
    for name, values in (("pressure_pa", message.pressure_pa), ("valid", message.valid)):
        if len(values) != SENSORS:
            raise ValueError(f"Pressure.{name} has {len(values)} values: must have {SENSORS}")
    if message.age_ns < 0:
        raise ValueError(f"Pressure.age_ns = {message.age_ns}: must not be negative")
    age = min(_AGE_LIMIT, -(-message.age_ns // CLASSIC_AGE_RESOLUTION_NS))
    word = bool(message.enable_request) << 12 | age << 13
    for i, (value, valid) in enumerate(zip(message.pressure_pa, message.valid, strict=True)):
        raw = signed("Pressure.pressure_pa", value, CLASSIC_PRESSURE_RESOLUTION_PA, -INT12_MAX, INT12_MAX)
        word |= ((raw if valid else _INVALID) & 0xFFF) << (16 + 12 * i)
    return word.to_bytes(LENGTH, "little")


def parse_pressure(data: bytes) -> Pressure | None:
    """The message in 8 bytes, or None if there are not 8. A pressure that is not valid is 0."""
    if len(data) != LENGTH:
        return None
    word = int.from_bytes(data, "little")
    raw = [_signed_field(word, 16 + 12 * i, 12) for i in range(SENSORS)]
    age = word >> 13 & 0b111
    return Pressure(
        pressure_pa=tuple(0.0 if value == _INVALID else value * CLASSIC_PRESSURE_RESOLUTION_PA for value in raw),
        valid=tuple(value != _INVALID for value in raw),
        enable_request=bool(word >> 12 & 1),
        age_ns=STALE_NS if age == _AGE_LIMIT else age * CLASSIC_AGE_RESOLUTION_NS,
    )


def emit_jet_command(message: JetCommand) -> bytes:
    """8 bytes. Raises ValueError for a flow that is not finite or out of the wire's range, or a bad counter."""
    flow = signed(
        "JetCommand.flow_m2_per_s", message.flow_m2_per_s, FLOW_RESOLUTION_M2_PER_S, -INT16_MAX - 1, INT16_MAX
    )
    word = Mode(message.mode) << 12 | bool(message.enable) << 15 | (flow & 0xFFFF) << 16
    if message.pressure_counter is not None:
        word |= 1 << 32 | unsigned("JetCommand.pressure_counter", message.pressure_counter, 0xF) << 36
    return word.to_bytes(LENGTH, "little")


def parse_jet_command(data: bytes) -> JetCommand | None:
    """The message in 8 bytes, or None if there are not 8 or the mode is not in its table."""
    if len(data) != LENGTH:
        return None
    word = int.from_bytes(data, "little")
    mode = word >> 12 & 0b111
    if mode not in _MODES:
        return None
    return JetCommand(
        flow_m2_per_s=_signed_field(word, 16, 16) * FLOW_RESOLUTION_M2_PER_S,
        mode=Mode(mode),
        enable=bool(word >> 15 & 1),
        pressure_counter=word >> 36 & 0xF if word >> 32 & 1 else None,
    )


def emit_ecu_status(message: EcuStatus) -> bytes:
    """8 bytes; counts stay at their largest values. Raises ValueError for a negative count or a hash too large."""
    word = Mode(message.state) << 12 | Reason(message.reason) << 16
    word |= _count("EcuStatus.bus_off", message.bus_off, CLASSIC_BUS_OFF_LIMIT) << 20
    counts = ("overruns", "missed", "crc_errors", "refused")
    for i, name in enumerate(counts):
        word |= _count(f"EcuStatus.{name}", getattr(message, name), CLASSIC_COUNT_LIMIT) << (24 + 6 * i)
    word |= unsigned("EcuStatus.bundle_hash", message.bundle_hash, 0xFFFFFFFF) >> 16 << 48
    return word.to_bytes(LENGTH, "little")


def parse_ecu_status(data: bytes) -> EcuStatus | None:
    """The message in 8 bytes, or None if there are not 8 or state or reason is not in its table.

    The lower half of the bundle's hash is 0: it was not sent.
    """
    if len(data) != LENGTH:
        return None
    word = int.from_bytes(data, "little")
    state, reason = word >> 12 & 0xF, word >> 16 & 0xF
    if state not in _MODES or reason not in _REASONS:
        return None
    overruns, missed, crc_errors, refused = (word >> (24 + 6 * i) & 0x3F for i in range(4))
    return EcuStatus(
        state=Mode(state),
        reason=Reason(reason),
        overruns=overruns,
        missed=missed,
        crc_errors=crc_errors,
        refused=refused,
        bus_off=word >> 20 & 0xF,
        bundle_hash=(word >> 48) << 16,
    )


def _signed_field(word: int, start: int, bits: int) -> int:
    value = word >> start & (1 << bits) - 1
    return value - (1 << bits) if value >> (bits - 1) else value


def _count(name: str, value: int, largest: int) -> int:
    if value < 0:
        raise ValueError(f"{name} = {value}: must not be negative")
    return min(value, largest)
