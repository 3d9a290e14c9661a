"""The identifiers, lengths, protection and resolutions of the messages, as in `contract/stillwake.dbc`. They are
repeated here because the runtime has no DBC parser; tests compare them with the file."""

from dataclasses import dataclass, replace
from typing import Final, Literal

from can_bridge.wire.frame import FD_LENGTHS, Frame

FRESHNESS_LENGTH: Final = 8
MAC_LENGTH: Final = 8
"""Number of bytes of the message authentication code at the end of a secured message."""


@dataclass(frozen=True, kw_only=True)
class MessageSpec:
    """The specification of one message.

    Attributes:
        protected: number of bytes that the E2E header protects, including the header; zeros and authentication follow.
        data_id: data ID of the E2E protection. The CRC covers the data ID, but no frame contains it.
        is_secured: whether the message ends in a freshness value and a message authentication code.
    """

    name: str
    frame_id: int
    length: int
    protected: int
    data_id: int
    profile: Literal[2, 5]
    is_fd: bool
    is_secured: bool = False

    def names(self, frame: Frame) -> bool:
        """Return whether a frame has this message's 11-bit identifier. A frame with 29 bits belongs to another node."""
        return frame.frame_id == self.frame_id and not frame.is_extended


def _fd(name: str, frame_id: int, length: int, data_id: int) -> MessageSpec:
    return MessageSpec(
        name=name, frame_id=frame_id, length=length, protected=length, data_id=data_id, profile=5, is_fd=True
    )


def _classic(plain: MessageSpec, data_id: int) -> MessageSpec:
    name, frame_id = f"{plain.name}Classic", plain.frame_id + 1
    return MessageSpec(name=name, frame_id=frame_id, length=8, protected=8, data_id=data_id, profile=2, is_fd=False)


def _secured(plain: MessageSpec, data_id: int) -> MessageSpec:
    name, frame_id = f"{plain.name}Secured", plain.frame_id + 2
    length = min(one for one in FD_LENGTHS if one >= plain.protected + FRESHNESS_LENGTH + MAC_LENGTH)
    return replace(plain, name=name, frame_id=frame_id, length=length, data_id=data_id, is_secured=True)


PRESSURE: Final = _fd("Pressure", 0x120, length=16, data_id=0x5701)
VEHICLE_SPEED: Final = _fd("VehicleSpeed", 0x128, length=8, data_id=0x5707)
JET_COMMAND: Final = _fd("JetCommand", 0x130, length=8, data_id=0x5702)
ECU_STATUS: Final = _fd("EcuStatus", 0x140, length=24, data_id=0x5703)

FD_SPECS: Final = (PRESSURE, VEHICLE_SPEED, JET_COMMAND, ECU_STATUS)
CLASSIC_SPECS: Final = tuple(map(_classic, FD_SPECS, (0x71, 0x74, 0x72, 0x73)))
SECURED_SPECS: Final = tuple(map(_secured, FD_SPECS, (0x5704, 0x5708, 0x5705, 0x5706)))
"""The messages of each set, in the order of their priority; each number is a data ID."""
PRESSURE_CLASSIC: Final = CLASSIC_SPECS[0]
PRESSURE_SECURED, _, JET_COMMAND_SECURED, _ = SECURED_SPECS
SPECS: Final = tuple(spec for forms in zip(FD_SPECS, CLASSIC_SPECS, SECURED_SPECS, strict=True) for spec in forms)

FLOW_RESOLUTION_M2_PER_S: Final = 0.0002
"""Resolution of the flow in all message sets, so that the command gate does not depend on the set."""

SPEED_RESOLUTION_M_PER_S: Final = 0.005
DENSITY_RESOLUTION_KG_PER_M3: Final = 0.01
SPEED_UNKNOWN: Final = 0xFFFF
DENSITY_UNKNOWN: Final = 0
"""Raw value for an unknown density. The resolutions of speed and density and these raw values are equal in all sets."""

PRESSURE_RESOLUTION_PA: Final = 0.1
AGE_RESOLUTION_NS: Final = 10_000

CLASSIC_PRESSURE_RESOLUTION_PA: Final = 1.0
CLASSIC_AGE_RESOLUTION_NS: Final = 10_000_000

INT16_MAX: Final = 0x7FFF
INT12_MAX: Final = 0x7FF
