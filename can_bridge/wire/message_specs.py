"""Identifiers, lengths and resolutions on the wire.

These restate `contract/stillwake.dbc`, which defines them: the runtime has no DBC parser, and the tests compare
every number here with the file.
"""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, kw_only=True)
class MessageSpec:
    """How one message is known on the bus.

    Attributes:
        frame_id: 11-bit identifier.
        length: bytes, the E2E header included.
        data_id: E2E data ID; never sent, only mixed into the CRC.
    """

    name: str
    frame_id: int
    length: int
    data_id: int


PRESSURE: Final = MessageSpec(name="Pressure", frame_id=0x120, length=16, data_id=0x5701)
JET_COMMAND: Final = MessageSpec(name="JetCommand", frame_id=0x130, length=8, data_id=0x5702)
ECU_STATUS: Final = MessageSpec(name="EcuStatus", frame_id=0x140, length=16, data_id=0x5703)
SPECS: Final = (PRESSURE, JET_COMMAND, ECU_STATUS)

PRESSURE_RESOLUTION_PA: Final = 0.1
FLOW_RESOLUTION_M2_PER_S: Final = 0.0002
AGE_RESOLUTION_NS: Final = 10_000

INT16_MAX: Final = 0x7FFF
