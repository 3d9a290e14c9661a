"""The sets of messages that a bus can carry, with the functions that convert each set's messages to bytes and back.

A bus has one set: `bus.frames` selects CAN FD or classic CAN, and `bus.key` selects the authenticated form of the CAN
FD set. Each set has its own identifiers, so that the frames of a node with another set are recognised, not misread.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Final, Generic, TypeVar

from can_bridge.wire import classic_codec, codec
from can_bridge.wire import message_specs as specs
from can_bridge.wire.message_specs import MessageSpec
from can_bridge.wire.messages import EcuStatus, JetCommand, Pressure, VehicleSpeed
from contract.config.vehicle import BusConfig

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Message(Generic[T]):
    """A message of a set, with its functions `emit_*` and `parse_*` of the set's codec."""

    spec: MessageSpec
    emit: Callable[[T], bytes]
    parse: Callable[[bytes], T | None]


@dataclass(frozen=True, kw_only=True)
class MessageSet:
    """The messages that the vehicle and the ECU exchange.

    Attributes:
        pressure_resolution_pa: resolution of a pressure in Pa.
        pressure_limit_pa: largest magnitude of a valid pressure in Pa.
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


def _set(name: str, by: ModuleType, named: Sequence[MessageSpec], resolution_pa: float, most_steps: int) -> MessageSet:
    """Return the set of messages that the codec `by` converts; the messages are in the order of `MessageSet.specs`."""
    pressure, speed, command, status = named
    return MessageSet(
        name=name,
        pressure=Message(spec=pressure, emit=by.emit_pressure, parse=by.parse_pressure),
        speed=Message(spec=speed, emit=by.emit_vehicle_speed, parse=by.parse_vehicle_speed),
        command=Message(spec=command, emit=by.emit_jet_command, parse=by.parse_jet_command),
        status=Message(spec=status, emit=by.emit_ecu_status, parse=by.parse_ecu_status),
        pressure_resolution_pa=resolution_pa,
        pressure_limit_pa=most_steps * resolution_pa,
    )


FD: Final = _set("CAN FD", codec, specs.FD_SPECS, specs.PRESSURE_RESOLUTION_PA, specs.INT16_MAX)
SECURED: Final = _set(
    "CAN FD, authenticated", codec, specs.SECURED_SPECS, specs.PRESSURE_RESOLUTION_PA, specs.INT16_MAX
)
CLASSIC: Final = _set(
    "classic CAN", classic_codec, specs.CLASSIC_SPECS, specs.CLASSIC_PRESSURE_RESOLUTION_PA, specs.INT12_MAX
)
SETS: Final = (FD, CLASSIC, SECURED)


def message_set(config: BusConfig) -> MessageSet:
    if config.frames == "classic":
        return CLASSIC
    return SECURED if config.key else FD
