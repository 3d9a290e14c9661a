"""Messages by name and value to the protected part of a frame, as a person types them.

The codec decides what the wire can carry. Signals that are not named are zero.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Final, TypeVar

from can_bridge.tools.signals import INVALID, LONGEST_MS, NO_SPEED, PROTECTION, STALE_MS, decode
from can_bridge.wire.classic_codec import STALE_NS
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import SETS, Message
from can_bridge.wire.message_specs import DENSITY_UNKNOWN, MessageSpec
from can_bridge.wire.messages import SENSORS, EcuStatus, JetCommand, Mode, Pressure, Reason, VehicleSpeed
from contract.errors import BusError

T = TypeVar("T")

NAMES: Final = tuple(spec.name for one in SETS for spec in one.specs)

_TABLES: Final[Mapping[str, type[Mode] | type[Reason]]] = {"Mode": Mode, "State": Mode, "Reason": Reason}


def encode(name: str, assignments: Sequence[str]) -> tuple[MessageSpec, bytes]:
    """The message's specification and its bytes with an empty E2E header.

    Args:
        name: of one of our messages, as the DBC has it.
        assignments: "signal=value"; a value is a number in the signal's unit, or a name from its table.

    Raises:
        BusError: for an unknown message or signal, or a value that the wire cannot carry.
    """
    emit = _emitters().get(name)
    if emit is None:
        raise BusError(f"{name}: is none of {', '.join(NAMES)}; `python -m can.player` sends other frames, from a log")
    spec, known, build = emit
    values: dict[str, float] = dict.fromkeys(known, 0.0)
    for text in assignments:
        signal, equals, value = text.partition("=")
        if signal in PROTECTION:
            raise BusError(f"{text}: {signal} is filled in by the sender; --counter names the first counter")
        if not equals or signal not in known:
            raise BusError(f"{text}: must be SIGNAL=VALUE with one of {', '.join(known)}")
        values[signal] = _number(text, signal, value)
    try:
        data = build(values)
    except (ValueError, OverflowError) as error:
        raise BusError(f"{name} cannot be sent: {error}") from error
    _check_kept(spec, data, values)
    return spec, data


def _check_kept(spec: MessageSpec, data: bytes, values: Mapping[str, float]) -> None:
    """Refuse whole numbers that the codec limits silently, as it does for counts that stay at their largest value."""
    padded = data + bytes(spec.length - len(data))
    decoded = decode(Frame(frame_id=spec.frame_id, data=padded, is_fd=spec.is_fd))
    sent = {} if decoded is None else {one.name: one for one in decoded.signals}
    for name, value in values.items():
        if not sent[name].unit and sent[name].value != value:
            raise BusError(f"{name}={value:g}: the wire would carry {sent[name].value:g}")


def _number(text: str, signal: str, value: str) -> float:
    table = _TABLES.get(signal)
    if table is not None and value in table.__members__:
        return float(table[value].value)
    if signal.startswith("Pressure") and value == "INVALID":
        return INVALID
    if (signal, value) == ("Speed", "NOT_AVAILABLE"):
        return NO_SPEED
    if (signal, value) == ("AirDensity", "NOT_KNOWN"):
        return DENSITY_UNKNOWN
    try:
        return float(int(value, 0))
    except ValueError:
        pass
    try:
        return float(value)
    except ValueError:
        names = f", or one of {', '.join(table.__members__)}" if table is not None else ""
        raise BusError(f"{text}: must be a number{names}") from None


_Emitter = tuple[MessageSpec, tuple[str, ...], Callable[[Mapping[str, float]], bytes]]


def _emitters() -> dict[str, _Emitter]:
    emitters: dict[str, _Emitter] = {}
    for one in SETS:
        is_fd = one.pressure.spec.is_fd
        emitters |= (
            _emitter(one.pressure, _pressure if is_fd else _classic_pressure)
            | _emitter(one.speed, _speed if is_fd else _classic_speed)
            | _emitter(one.command, _command)
            | _emitter(one.status, _status if is_fd else _classic_status)
        )
    return emitters


def _emitter(message: Message[T], build: Callable[[Mapping[str, float]], T]) -> dict[str, _Emitter]:
    spec = message.spec
    decoded = decode(Frame(frame_id=spec.frame_id, data=bytes(spec.length), is_fd=spec.is_fd))
    names = () if decoded is None else tuple(one.name for one in decoded.signals if one.name not in PROTECTION)
    return {spec.name: (spec, names, lambda values: message.emit(build(values)))}


def _pressure(values: Mapping[str, float]) -> Pressure:
    return Pressure(
        pressure_pa=tuple(values[f"Pressure{i}"] for i in range(SENSORS)),
        valid=tuple(_flag(values, f"Valid{i}") for i in range(SENSORS)),
        enable_request=_flag(values, "EnableRequest"),
        age_ns=round(values["Age"] * 1e6),
    )


def _classic_pressure(values: Mapping[str, float]) -> Pressure:
    pressures = [values[f"Pressure{i}"] for i in range(SENSORS)]
    if values["Age"] > STALE_MS:
        raise ValueError(f"Age = {values['Age']:g}: must be in 0..{STALE_MS} ms, which also stands for all above")
    return Pressure(
        pressure_pa=tuple(0.0 if pressure == INVALID else pressure for pressure in pressures),
        valid=tuple(pressure != INVALID for pressure in pressures),
        enable_request=_flag(values, "EnableRequest"),
        age_ns=STALE_NS if values["Age"] == STALE_MS else round(values["Age"] * 1e6),
    )


def _speed(values: Mapping[str, float]) -> VehicleSpeed:
    return VehicleSpeed(
        speed_m_per_s=None if values["Speed"] == NO_SPEED else values["Speed"],
        age_ns=round(values["Age"] * 1e6),
        density_kg_per_m3=None if values["AirDensity"] == DENSITY_UNKNOWN else values["AirDensity"],
    )


def _classic_speed(values: Mapping[str, float]) -> VehicleSpeed:
    if values["Age"] > LONGEST_MS:
        raise ValueError(f"Age = {values['Age']:g}: must be in 0..{LONGEST_MS} ms, which also stands for all above")
    return _speed(values)


def _command(values: Mapping[str, float]) -> JetCommand:
    has_counter = _flag(values, "PressureCounterValid")
    return JetCommand(
        flow_m2_per_s=values["Flow"],
        mode=Mode(_whole(values, "Mode")),
        enable=_flag(values, "Enable"),
        pressure_counter=_whole(values, "PressureCounter") if has_counter else None,
        next_period=_flag(values, "NextPeriod"),
    )


def _classic_status(values: Mapping[str, float]) -> EcuStatus:
    return _filled_status(values, bundle_hash=_whole(values, "BundleHash") << 16)


def _status(values: Mapping[str, float]) -> EcuStatus:
    return _filled_status(
        values,
        bundle_hash=_whole(values, "BundleHash"),
        not_authentic=_whole(values, "NotAuthentic"),
        tx_errors=_whole(values, "TxErrors"),
        rx_errors=_whole(values, "RxErrors"),
        set_aside=sum(_flag(values, f"SetAside{i}") << i for i in range(SENSORS)),
    )


def _filled_status(values: Mapping[str, float], **others: int) -> EcuStatus:
    return EcuStatus(
        state=Mode(_whole(values, "State")),
        reason=Reason(_whole(values, "Reason")),
        overruns=_whole(values, "Overruns"),
        missed=_whole(values, "Missed"),
        crc_errors=_whole(values, "CrcErrors"),
        refused=_whole(values, "Refused"),
        bus_off=_whole(values, "BusOff"),
        **others,
    )


def _flag(values: Mapping[str, float], name: str) -> bool:
    if values[name] not in (0.0, 1.0):
        raise ValueError(f"{name} = {values[name]:g}: must be 0 or 1")
    return bool(values[name])


def _whole(values: Mapping[str, float], name: str) -> int:
    if not values[name].is_integer():
        raise ValueError(f"{name} = {values[name]:g}: must be a whole number")
    return int(values[name])
