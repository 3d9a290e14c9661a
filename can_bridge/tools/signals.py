"""Frames as named signals with units, and back: for people, where nodes use `can_bridge.wire.message_sets`.

Names and units are those of `contract/stillwake.dbc`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from can_bridge.e2e.profiles import profile_of
from can_bridge.wire.classic_codec import STALE_NS
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import SETS, Message
from can_bridge.wire.message_specs import (
    DENSITY_UNKNOWN,
    FRESHNESS_LENGTH,
    INT12_MAX,
    MAC_LENGTH,
    SPEED_RESOLUTION_M_PER_S,
    SPEED_UNKNOWN,
    MessageSpec,
)
from can_bridge.wire.messages import SENSORS, EcuStatus, JetCommand, Pressure, VehicleSpeed

PROTECTION: Final = frozenset({"E2E_CRC", "E2E_Counter", "Freshness", "MAC"})
"""Signals that only show whether to trust the others."""

STALE_MS: Final = 70
"""The classic set's largest age: so much or more."""
INVALID: Final = -INT12_MAX - 1
"""The classic set's pressure of a sensor whose own diagnosis failed, Pa."""
NO_SPEED: Final = SPEED_UNKNOWN * SPEED_RESOLUTION_M_PER_S
"""The speed of a vehicle that does not know it, m/s."""


@dataclass(frozen=True, kw_only=True)
class Signal:
    """One value.

    Attributes:
        value: in `unit`.
        text: what people know it by: its name in the table of values, or a hash's digits; empty without one.
    """

    name: str
    value: float
    unit: str = ""
    text: str = ""

    @property
    def shown(self) -> str:
        """The value for people: its name where it has one, no digits that the wire does not carry."""
        return self.text or (str(self.value) if isinstance(self.value, int) else f"{self.value:.10g}")


@dataclass(frozen=True, kw_only=True)
class Decoded:
    """The content of a frame.

    Attributes:
        signals: in the order of the frame; empty if it has no meaning: a value outside its table, a wrong length.
        spec: of our own messages; None for others.
    """

    name: str
    signals: tuple[Signal, ...]
    spec: MessageSpec | None = None


_OWN: Final[Mapping[int, Message[Pressure] | Message[VehicleSpeed] | Message[JetCommand] | Message[EcuStatus]]] = {
    message.spec.frame_id: message for one in SETS for message in (one.pressure, one.speed, one.command, one.status)
}


def decode(frame: Frame) -> Decoded | None:
    """One of stillwake's own messages, by our own codec; None for any other."""
    message = None if frame.is_extended else _OWN.get(frame.frame_id)
    if message is None:
        return None
    spec, data = message.spec, frame.data
    if len(data) != spec.length:
        return Decoded(name=spec.name, signals=(), spec=spec)
    value = message.parse(data[: spec.protected])
    if value is None:
        return Decoded(name=spec.name, signals=(), spec=spec)
    profile = profile_of(spec)
    head = (
        Signal(name="E2E_CRC", value=profile.crc_of(data)),
        Signal(name="E2E_Counter", value=profile.counter_of(data)),
    )
    tail: tuple[Signal, ...] = ()
    if spec.is_secured:
        mac, freshness = data[-MAC_LENGTH:], data[-MAC_LENGTH - FRESHNESS_LENGTH : -MAC_LENGTH]
        tail = (
            Signal(name="Freshness", value=int.from_bytes(freshness, "big")),
            Signal(name="MAC", value=int.from_bytes(mac, "big"), text=f"0x{mac.hex()}"),
        )
    return Decoded(name=spec.name, signals=(*head, *_signals(value, spec), *tail), spec=spec)


def _signals(value: Pressure | VehicleSpeed | JetCommand | EcuStatus, spec: MessageSpec) -> tuple[Signal, ...]:
    match value:
        case Pressure():
            return _of_pressure(value) if spec.is_fd else _of_classic_pressure(value)
        case VehicleSpeed():
            return _of_speed(value)
        case JetCommand():
            return _of_command(value)
    return _of_status(value) if spec.is_fd else _of_classic_status(value)


def _of_pressure(value: Pressure) -> tuple[Signal, ...]:
    return (
        *(Signal(name=f"Valid{i}", value=int(valid)) for i, valid in enumerate(value.valid)),
        Signal(name="EnableRequest", value=int(value.enable_request)),
        *(Signal(name=f"Pressure{i}", value=pressure, unit="Pa") for i, pressure in enumerate(value.pressure_pa)),
        Signal(name="Age", value=value.age_ns / 1e6, unit="ms"),
    )


def _of_classic_pressure(value: Pressure) -> tuple[Signal, ...]:
    return (
        Signal(name="EnableRequest", value=int(value.enable_request)),
        Signal(name="Age", value=STALE_MS if value.age_ns == STALE_NS else value.age_ns / 1e6, unit="ms"),
        *(
            _or_word(f"Pressure{i}", pressure if valid else None, "Pa", INVALID, "INVALID")
            for i, (pressure, valid) in enumerate(zip(value.pressure_pa, value.valid, strict=True))
        ),
    )


def _of_speed(value: VehicleSpeed) -> tuple[Signal, ...]:
    speed, age_ns, density = value
    return (
        _or_word("AirDensity", density, "kg/m3", DENSITY_UNKNOWN, "NOT_KNOWN"),
        _or_word("Speed", speed, "m/s", NO_SPEED, "NOT_AVAILABLE"),
        Signal(name="Age", value=age_ns / 1e6, unit="ms"),
    )


def _or_word(name: str, value: float | None, unit: str, without: float, word: str) -> Signal:
    """A value that may be missing: then the wire has another number for it, with a name in the table."""
    if value is None:
        return Signal(name=name, value=without, unit=unit, text=word)
    return Signal(name=name, value=value, unit=unit)


def _of_command(value: JetCommand) -> tuple[Signal, ...]:
    return (
        Signal(name="Mode", value=int(value.mode), text=value.mode.name),
        Signal(name="Enable", value=int(value.enable)),
        Signal(name="PressureCounterValid", value=int(value.pressure_counter is not None)),
        Signal(name="NextPeriod", value=int(value.next_period)),
        Signal(name="Flow", value=value.flow_m2_per_s, unit="m2/s"),
        Signal(name="PressureCounter", value=value.pressure_counter or 0),
    )


def _counted(value: EcuStatus) -> tuple[Signal, ...]:
    return (
        Signal(name="State", value=int(value.state), text=value.state.name),
        Signal(name="Reason", value=int(value.reason), text=value.reason.name),
        Signal(name="BusOff", value=value.bus_off),
        Signal(name="Overruns", value=value.overruns),
        Signal(name="Missed", value=value.missed),
        Signal(name="CrcErrors", value=value.crc_errors),
    )


def _of_classic_status(value: EcuStatus) -> tuple[Signal, ...]:
    return (
        *_counted(value),
        Signal(name="Refused", value=value.refused),
        Signal(name="BundleHash", value=value.bundle_hash >> 16, text=f"{value.bundle_hash >> 16:#06x}"),
    )


def _of_status(value: EcuStatus) -> tuple[Signal, ...]:
    return (
        *_counted(value),
        Signal(name="BundleHash", value=value.bundle_hash, text=f"{value.bundle_hash:#010x}"),
        Signal(name="Refused", value=value.refused),
        Signal(name="NotAuthentic", value=value.not_authentic),
        Signal(name="TxErrors", value=value.tx_errors),
        Signal(name="RxErrors", value=value.rx_errors),
        *(Signal(name=f"SetAside{i}", value=value.set_aside >> i & 1) for i in range(SENSORS)),
    )
