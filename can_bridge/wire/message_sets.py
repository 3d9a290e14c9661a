"""The sets of messages that a bus can carry, and what both nodes must know of the one in use.

One set at a time: `bus.frames` chooses CAN FD or classic CAN, `bus.key` the authenticated form of the CAN FD set. Each
set has identifiers of its own, so that a node of another set is seen on the bus and not misread.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from can_bridge.wire import classic_codec, codec
from can_bridge.wire import message_specs as specs
from can_bridge.wire.message_specs import MessageSpec
from can_bridge.wire.messages import EcuStatus, JetCommand, Pressure, VehicleSpeed
from contract.config.vehicle import BusConfig

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Message(Generic[T]):
    """One message of a set.

    Attributes:
        emit: value to the protected bytes with an empty E2E header; raises ValueError.
        parse: protected bytes to the value, or None; never raises.
    """

    spec: MessageSpec
    emit: Callable[[T], bytes]
    parse: Callable[[bytes], T | None]


@dataclass(frozen=True, kw_only=True)
class MessageSet:
    """What the two nodes exchange.

    Attributes:
        pressure_resolution_pa: step of a pressure on the wire.
        pressure_limit_pa: largest magnitude of a valid pressure.
    """

    name: str
    pressure: Message[Pressure]
    speed: Message[VehicleSpeed]
    command: Message[JetCommand]
    status: Message[EcuStatus]
    pressure_resolution_pa: float
    pressure_limit_pa: float

    @property
    def specs(self) -> tuple[MessageSpec, MessageSpec, MessageSpec, MessageSpec]:
        """The specifications of the four messages, in the order of their priority on the bus."""
        return self.pressure.spec, self.speed.spec, self.command.spec, self.status.spec


def _fd_set(
    name: str, pressure: MessageSpec, speed: MessageSpec, command: MessageSpec, status: MessageSpec
) -> MessageSet:
    return MessageSet(
        name=name,
        pressure=Message(spec=pressure, emit=codec.emit_pressure, parse=codec.parse_pressure),
        speed=Message(spec=speed, emit=codec.emit_vehicle_speed, parse=codec.parse_vehicle_speed),
        command=Message(spec=command, emit=codec.emit_jet_command, parse=codec.parse_jet_command),
        status=Message(spec=status, emit=codec.emit_ecu_status, parse=codec.parse_ecu_status),
        pressure_resolution_pa=specs.PRESSURE_RESOLUTION_PA,
        pressure_limit_pa=specs.INT16_MAX * specs.PRESSURE_RESOLUTION_PA,
    )


FD: Final = _fd_set("CAN FD", specs.PRESSURE, specs.VEHICLE_SPEED, specs.JET_COMMAND, specs.ECU_STATUS)
SECURED: Final = _fd_set(
    "CAN FD, authenticated",
    specs.PRESSURE_SECURED,
    specs.VEHICLE_SPEED_SECURED,
    specs.JET_COMMAND_SECURED,
    specs.ECU_STATUS_SECURED,
)
CLASSIC: Final = MessageSet(
    name="classic CAN",
    pressure=Message(spec=specs.PRESSURE_CLASSIC, emit=classic_codec.emit_pressure, parse=classic_codec.parse_pressure),
    speed=Message(
        spec=specs.VEHICLE_SPEED_CLASSIC,
        emit=classic_codec.emit_vehicle_speed,
        parse=classic_codec.parse_vehicle_speed,
    ),
    command=Message(
        spec=specs.JET_COMMAND_CLASSIC, emit=classic_codec.emit_jet_command, parse=classic_codec.parse_jet_command
    ),
    status=Message(
        spec=specs.ECU_STATUS_CLASSIC, emit=classic_codec.emit_ecu_status, parse=classic_codec.parse_ecu_status
    ),
    pressure_resolution_pa=specs.CLASSIC_PRESSURE_RESOLUTION_PA,
    pressure_limit_pa=specs.INT12_MAX * specs.CLASSIC_PRESSURE_RESOLUTION_PA,
)
SETS: Final = (FD, CLASSIC, SECURED)


def message_set(config: BusConfig) -> MessageSet:
    """The set that these settings choose."""
    if config.frames == "classic":
        return CLASSIC
    return SECURED if config.key else FD
