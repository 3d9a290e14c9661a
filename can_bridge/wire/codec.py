"""The messages of the CAN FD set to data bytes and back, as laid out in `contract/stillwake.dbc`.

`emit_*` returns the protected part of a message with an empty E2E header (`can_bridge.e2e` fills it) and raises
ValueError for what the wire cannot carry. `parse_*` looks at the meaning only, not at the header, and returns None
for data of another length or with a value outside a table; no bytes make it raise. Values are rounded to the
nearest step of the wire; bits without a signal are sent as zero and ignored when received.
"""

import struct
from typing import Final

from can_bridge.wire.message_specs import (
    AGE_RESOLUTION_NS,
    FLOW_RESOLUTION_M2_PER_S,
    INT16_MAX,
    PRESSURE_RESOLUTION_PA,
)
from can_bridge.wire.messages import (
    BUS_OFF_LIMIT,
    COUNT_LIMIT,
    ERROR_LIMIT,
    SENSORS,
    EcuStatus,
    JetCommand,
    Mode,
    Pressure,
    Reason,
)
from can_bridge.wire.packing import signed, unsigned

# "3x" is the E2E header: CRC-16 and counter.
_PRESSURE: Final = struct.Struct("<3x B 4h H 2x")  # flags, pressures, age
_JET_COMMAND: Final = struct.Struct("<3x B h B x")  # flags, flow, echoed counter
# State, reason, bus-off, overruns, missed, CRC errors, hash, refused, not authentic, transmit and receive errors.
_ECU_STATUS: Final = struct.Struct("<3x B B B H H H I H H B B 2x")

_ENABLE_REQUEST: Final = 1 << SENSORS  # above the validity bits

_MODE_MASK: Final = 0b111
_ENABLE: Final = 1 << 3
_COUNTER_VALID: Final = 1 << 4

_STATE_MASK: Final = 0b1111

_MODES: Final = frozenset(Mode)
_REASONS: Final = frozenset(Reason)


def emit_pressure(message: Pressure) -> bytes:
    """16 bytes. Raises ValueError for a wrong count, a value that is not finite or out of the wire's range."""
    for name, values in (("pressure_pa", message.pressure_pa), ("valid", message.valid)):
        if len(values) != SENSORS:
            raise ValueError(f"Pressure.{name} has {len(values)} values: must have {SENSORS}")
    flags = sum(1 << i for i, valid in enumerate(message.valid) if valid)
    if message.enable_request:
        flags |= _ENABLE_REQUEST
    raw = [_int16("Pressure.pressure_pa", value, PRESSURE_RESOLUTION_PA) for value in message.pressure_pa]
    # Half a step up, in whole numbers: ages are exact.
    age = (message.age_ns + AGE_RESOLUTION_NS // 2) // AGE_RESOLUTION_NS
    return _PRESSURE.pack(flags, *raw, unsigned("Pressure.age_ns / 10 us", age, 0xFFFF))


def parse_pressure(data: bytes) -> Pressure | None:
    """The message in 16 bytes, or None if there are not 16."""
    if len(data) != _PRESSURE.size:
        return None
    flags, *raw, age = _PRESSURE.unpack(data)
    return Pressure(
        pressure_pa=tuple(value * PRESSURE_RESOLUTION_PA for value in raw),
        valid=tuple(bool(flags >> i & 1) for i in range(SENSORS)),
        enable_request=bool(flags & _ENABLE_REQUEST),
        age_ns=age * AGE_RESOLUTION_NS,
    )


def emit_jet_command(message: JetCommand) -> bytes:
    """8 bytes. Raises ValueError for a flow that is not finite or out of the wire's range, or a bad counter."""
    flags = Mode(message.mode) | (_ENABLE if message.enable else 0)
    counter = 0
    if message.pressure_counter is not None:
        flags |= _COUNTER_VALID
        counter = unsigned("JetCommand.pressure_counter", message.pressure_counter, 0xFF)
    flow = _int16("JetCommand.flow_m2_per_s", message.flow_m2_per_s, FLOW_RESOLUTION_M2_PER_S)
    return _JET_COMMAND.pack(flags, flow, counter)


def parse_jet_command(data: bytes) -> JetCommand | None:
    """The message in 8 bytes, or None if there are not 8 or the mode is not in its table."""
    if len(data) != _JET_COMMAND.size:
        return None
    flags, flow, counter = _JET_COMMAND.unpack(data)
    mode = flags & _MODE_MASK
    if mode not in _MODES:
        return None
    return JetCommand(
        flow_m2_per_s=flow * FLOW_RESOLUTION_M2_PER_S,
        mode=Mode(mode),
        enable=bool(flags & _ENABLE),
        pressure_counter=counter if flags & _COUNTER_VALID else None,
    )


def emit_ecu_status(message: EcuStatus) -> bytes:
    """24 bytes. Raises ValueError for a count or hash that does not fit."""
    return _ECU_STATUS.pack(
        Mode(message.state),
        Reason(message.reason),
        unsigned("EcuStatus.bus_off", message.bus_off, BUS_OFF_LIMIT),
        unsigned("EcuStatus.overruns", message.overruns, COUNT_LIMIT),
        unsigned("EcuStatus.missed", message.missed, COUNT_LIMIT),
        unsigned("EcuStatus.crc_errors", message.crc_errors, COUNT_LIMIT),
        unsigned("EcuStatus.bundle_hash", message.bundle_hash, 0xFFFFFFFF),
        unsigned("EcuStatus.refused", message.refused, COUNT_LIMIT),
        unsigned("EcuStatus.not_authentic", message.not_authentic, COUNT_LIMIT),
        unsigned("EcuStatus.tx_errors", message.tx_errors, ERROR_LIMIT),
        unsigned("EcuStatus.rx_errors", message.rx_errors, ERROR_LIMIT),
    )


def parse_ecu_status(data: bytes) -> EcuStatus | None:
    """The message in 24 bytes, or None if there are not 24 or state or reason is not in its table."""
    if len(data) != _ECU_STATUS.size:
        return None
    state, reason, bus_off, overruns, missed, crc_errors, bundle_hash, *rest = _ECU_STATUS.unpack(data)
    refused, not_authentic, tx_errors, rx_errors = rest
    state &= _STATE_MASK
    if state not in _MODES or reason not in _REASONS:
        return None
    return EcuStatus(
        state=Mode(state),
        reason=Reason(reason),
        overruns=overruns,
        missed=missed,
        crc_errors=crc_errors,
        refused=refused,
        not_authentic=not_authentic,
        bus_off=bus_off,
        tx_errors=tx_errors,
        rx_errors=rx_errors,
        bundle_hash=bundle_hash,
    )


def _int16(name: str, value: float, resolution: float) -> int:
    return signed(name, value, resolution, -INT16_MAX - 1, INT16_MAX)
