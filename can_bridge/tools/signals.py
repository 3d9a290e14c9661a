"""The conversion between frames and named signals with units, for people; nodes use `can_bridge.wire.message_sets`.

`contract/stillwake.dbc` defines the names and units.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import contract
from can_bridge.e2e.profiles import profile_of
from can_bridge.wire import message_specs as specs
from can_bridge.wire.classic_codec import STALE_NS
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import SETS, Message
from can_bridge.wire.message_specs import FRESHNESS_LENGTH, MAC_LENGTH, MessageSpec
from can_bridge.wire.messages import SENSORS, EcuStatus, JetCommand, Pressure, VehicleSpeed
from can_bridge.wire.network_file import load_network
from contract.errors import BusError

if TYPE_CHECKING:
    from cantools.database.can.signal import Signal

PROTECTION: Final = frozenset({"E2E_CRC", "E2E_Counter", "Freshness", "MAC"})
"""Signals that only serve to protect the message."""


class SignalValue(NamedTuple):
    """The physical value of one signal. `text` is the value's name in the signal's table, or the digits of a hash."""

    name: str
    value: float
    unit: str = ""
    text: str = ""

    @property
    def shown(self) -> str:
        """The value as text: the value's name if there is one, otherwise the number with up to ten digits."""
        return self.text or (str(self.value) if isinstance(self.value, int) else f"{self.value:.10g}")


class Decoded(NamedTuple):
    """One of our messages with its signals; none if the length is wrong, or a value is outside its signal's table."""

    spec: MessageSpec
    signals: tuple[SignalValue, ...]


_OWN: Final[Mapping[int, Message[Pressure] | Message[VehicleSpeed] | Message[JetCommand] | Message[EcuStatus]]] = {
    message.spec.frame_id: message for one in SETS for message in (one.pressure, one.speed, one.command, one.status)
}


def decode(frame: Frame) -> Decoded | None:
    """Return the content of one of stillwake's messages, decoded by our own codec; None for any other message."""
    if (message := None if frame.is_extended else _OWN.get(frame.frame_id)) is None:
        return None
    spec, data = message.spec, frame.data
    value = message.parse(data[: spec.protected]) if len(data) == spec.length else None
    if value is None:
        return Decoded(spec, ())
    profile = profile_of(spec)
    signals = [SignalValue("E2E_CRC", profile.crc_of(data)), SignalValue("E2E_Counter", profile.counter_of(data))]
    signals += _signals(value, spec)
    if spec.is_secured:
        mac, freshness = data[-MAC_LENGTH:], data[-MAC_LENGTH - FRESHNESS_LENGTH : -MAC_LENGTH]
        signals.append(SignalValue("Freshness", int.from_bytes(freshness, "big")))
        signals.append(SignalValue("MAC", int.from_bytes(mac, "big"), text=f"0x{mac.hex()}"))
    return Decoded(spec, tuple(signals))


def _signals(value: Pressure | VehicleSpeed | JetCommand | EcuStatus, spec: MessageSpec) -> Iterator[SignalValue]:
    match value:
        case Pressure() if spec.is_fd:
            yield from (SignalValue(f"Valid{i}", int(valid)) for i, valid in enumerate(value.valid))
            yield SignalValue("EnableRequest", int(value.enable_request))
            yield from (SignalValue(f"Pressure{i}", pressure, "Pa") for i, pressure in enumerate(value.pressure_pa))
            yield SignalValue("Age", value.age_ns / 1e6, "ms")
        case Pressure():
            yield SignalValue("EnableRequest", int(value.enable_request))
            # The largest value of the field, 70 ms, means this age or any greater age.
            yield SignalValue("Age", 70 if value.age_ns == STALE_NS else value.age_ns / 1e6, "ms")
            for i, (pressure, valid) in enumerate(zip(value.pressure_pa, value.valid, strict=True)):
                yield _or_word(f"Pressure{i}", pressure if valid else None, "Pa", -specs.INT12_MAX - 1, "INVALID")
        case VehicleSpeed():
            no_speed = specs.SPEED_UNKNOWN * specs.SPEED_RESOLUTION_M_PER_S
            yield _or_word("AirDensity", value.density_kg_per_m3, "kg/m3", specs.DENSITY_UNKNOWN, "NOT_KNOWN")
            yield _or_word("Speed", value.speed_m_per_s, "m/s", no_speed, "NOT_AVAILABLE")
            yield SignalValue("Age", value.age_ns / 1e6, "ms")
        case JetCommand():
            yield SignalValue("Mode", int(value.mode), text=value.mode.name)
            yield SignalValue("Enable", int(value.enable))
            yield SignalValue("PressureCounterValid", int(value.pressure_counter is not None))
            yield SignalValue("NextPeriod", int(value.next_period))
            yield SignalValue("Flow", value.flow_m2_per_s, "m2/s")
            yield SignalValue("PressureCounter", value.pressure_counter or 0)
        case EcuStatus():
            yield SignalValue("State", int(value.state), text=value.state.name)
            yield SignalValue("Reason", int(value.reason), text=value.reason.name)
            names = ("BusOff", "Overruns", "Missed", "CrcErrors")
            counts = (value.bus_off, value.overruns, value.missed, value.crc_errors)
            yield from map(SignalValue, names, counts)
            if not spec.is_fd:
                yield SignalValue("Refused", value.refused)
                yield SignalValue("BundleHash", value.bundle_hash >> 16, text=f"{value.bundle_hash >> 16:#06x}")
                return
            yield SignalValue("BundleHash", value.bundle_hash, text=f"{value.bundle_hash:#010x}")
            names = ("Refused", "NotAuthentic", "TxErrors", "RxErrors")
            yield from map(SignalValue, names, (value.refused, value.not_authentic, value.tx_errors, value.rx_errors))
            yield from (SignalValue(f"SetAside{i}", value.set_aside >> i & 1) for i in range(SENSORS))


def _or_word(name: str, value: float | None, unit: str, without: float, word: str) -> SignalValue:
    """Return a signal's value; for a missing value (None) the number is `without` and the text is `word`."""
    return SignalValue(name, without, unit, word) if value is None else SignalValue(name, value, unit)


DBC: Final = Path(contract.__file__).with_name("stillwake.dbc")
_SPECS: Final = {spec.name: spec for spec in specs.SPECS}
_read_once = cache(load_network)


def encode(name: str, assignments: Sequence[str]) -> tuple[MessageSpec, bytes]:
    """Return the message's specification and its bytes with an empty E2E header. Raises BusError for an unknown message
    or signal, a value out of range, or if cantools is missing. `assignments` are texts "signal=value", in which the
    value is a number in the signal's unit or a name from its table."""
    if name not in _SPECS:
        names = ", ".join(_SPECS)
        raise BusError(f"{name}: must be one of {names}; `python -m can.player` sends other frames, from a log")
    message = _read_once(DBC).get_message_by_name(name)
    from cantools.database import EncodeError

    signals = {one.name: one for one in message.signals}
    known = [signal for signal in signals if signal not in PROTECTION]
    given: dict[str, float | str] = {}
    for text in assignments:
        signal, equals, value = text.partition("=")
        if signal in PROTECTION:
            raise BusError(f"{text}: {signal} is filled in by the sender; --counter sets the first counter")
        if not equals or signal not in known:
            raise BusError(f"{text}: must be SIGNAL=VALUE; signals: {', '.join(known)}")
        if signal in given:
            raise BusError(f"{text}: {signal} is given twice")
        given[signal] = _value(text, signals[signal], value)
    try:
        data = message.encode({**dict.fromkeys(signals, 0), **given}, strict=True)
    except (EncodeError, ValueError, OverflowError) as error:
        raise BusError(f"{name} cannot be sent: {error}") from error
    spec = _SPECS[name]
    return spec, data[: spec.protected]


def _value(text: str, signal: "Signal", value: str) -> float | str:
    """Return a value's text as a number, or unchanged if it is a name in the signal's table of values."""
    names = [str(one) for one in (signal.choices or {}).values()]
    if value in names:
        return value
    with suppress(ValueError):
        return int(value, 0)
    try:
        number = float(value)
    except ValueError:
        others = f", or one of {', '.join(names)}" if names else ""
        raise BusError(f"{text}: must be a number{others}") from None
    if not signal.unit and not number.is_integer():
        raise BusError(f"{text}: must be a whole number")
    return number
