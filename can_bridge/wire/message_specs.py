"""Identifiers, lengths, protection and resolutions on the wire.

These restate `contract/stillwake.dbc`, which defines them: the runtime has no DBC parser, and the tests compare
every number here with the file.
"""

from dataclasses import dataclass
from typing import Final, Literal

from can_bridge.wire.frame import Frame

FRESHNESS_LENGTH: Final = 8
MAC_LENGTH: Final = 8
"""Bytes behind the protected part of a secured message."""


@dataclass(frozen=True, kw_only=True)
class MessageSpec:
    """How one message is known on the bus.

    Attributes:
        protected: of these, bytes under the E2E header, the header included; zeros and the authentication follow.
        data_id: E2E data ID; never sent, only mixed into the CRC.
        is_secured: ends in a freshness value and a message authentication code.
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
        """Whether a frame has this message's identifier; a 29-bit one of the same number is another node's."""
        return frame.frame_id == self.frame_id and not frame.is_extended


PRESSURE: Final = MessageSpec(
    name="Pressure", frame_id=0x120, length=16, protected=16, data_id=0x5701, profile=5, is_fd=True
)
VEHICLE_SPEED: Final = MessageSpec(
    name="VehicleSpeed", frame_id=0x128, length=8, protected=8, data_id=0x5707, profile=5, is_fd=True
)
JET_COMMAND: Final = MessageSpec(
    name="JetCommand", frame_id=0x130, length=8, protected=8, data_id=0x5702, profile=5, is_fd=True
)
ECU_STATUS: Final = MessageSpec(
    name="EcuStatus", frame_id=0x140, length=24, protected=24, data_id=0x5703, profile=5, is_fd=True
)

PRESSURE_CLASSIC: Final = MessageSpec(
    name="PressureClassic", frame_id=0x121, length=8, protected=8, data_id=0x71, profile=2, is_fd=False
)
VEHICLE_SPEED_CLASSIC: Final = MessageSpec(
    name="VehicleSpeedClassic", frame_id=0x129, length=8, protected=8, data_id=0x74, profile=2, is_fd=False
)
JET_COMMAND_CLASSIC: Final = MessageSpec(
    name="JetCommandClassic", frame_id=0x131, length=8, protected=8, data_id=0x72, profile=2, is_fd=False
)
ECU_STATUS_CLASSIC: Final = MessageSpec(
    name="EcuStatusClassic", frame_id=0x141, length=8, protected=8, data_id=0x73, profile=2, is_fd=False
)

PRESSURE_SECURED: Final = MessageSpec(
    name="PressureSecured",
    frame_id=0x122,
    length=32,
    protected=16,
    data_id=0x5704,
    profile=5,
    is_fd=True,
    is_secured=True,
)
VEHICLE_SPEED_SECURED: Final = MessageSpec(
    name="VehicleSpeedSecured",
    frame_id=0x12A,
    length=24,
    protected=8,
    data_id=0x5708,
    profile=5,
    is_fd=True,
    is_secured=True,
)
JET_COMMAND_SECURED: Final = MessageSpec(
    name="JetCommandSecured",
    frame_id=0x132,
    length=24,
    protected=8,
    data_id=0x5705,
    profile=5,
    is_fd=True,
    is_secured=True,
)
ECU_STATUS_SECURED: Final = MessageSpec(
    name="EcuStatusSecured",
    frame_id=0x142,
    length=48,
    protected=24,
    data_id=0x5706,
    profile=5,
    is_fd=True,
    is_secured=True,
)

SPECS: Final = (
    PRESSURE,
    PRESSURE_CLASSIC,
    PRESSURE_SECURED,
    VEHICLE_SPEED,
    VEHICLE_SPEED_CLASSIC,
    VEHICLE_SPEED_SECURED,
    JET_COMMAND,
    JET_COMMAND_CLASSIC,
    JET_COMMAND_SECURED,
    ECU_STATUS,
    ECU_STATUS_CLASSIC,
    ECU_STATUS_SECURED,
)

FLOW_RESOLUTION_M2_PER_S: Final = 0.0002
"""In every set of messages, so that the command gate need not know which is in use."""

SPEED_RESOLUTION_M_PER_S: Final = 0.005
DENSITY_RESOLUTION_KG_PER_M3: Final = 0.01
SPEED_UNKNOWN: Final = 0xFFFF
DENSITY_UNKNOWN: Final = 0
"""Steps of the wire for what the vehicle does not know; these four are the same in every set."""

PRESSURE_RESOLUTION_PA: Final = 0.1
AGE_RESOLUTION_NS: Final = 10_000

CLASSIC_PRESSURE_RESOLUTION_PA: Final = 1.0
CLASSIC_AGE_RESOLUTION_NS: Final = 10_000_000

INT16_MAX: Final = 0x7FFF
INT12_MAX: Final = 0x7FF
