"""What a tester reads of an ECU besides its store and its calibration."""

import struct
from collections.abc import Mapping

from can_bridge.uds.services import Did
from contract.config.tree import Config
from contract.release.checks import dbc_sha256
from ecu.flashable.equipment import Equipment


def identification(equipment: Equipment, config: Config) -> Mapping[Did, bytes]:
    """Identifiers whose values do not change while the ECU has power."""
    return {
        Did.SERIAL_NUMBER: equipment.serial.encode(),
        Did.HARDWARE: equipment.hardware.encode(),
        Did.SOFTWARE_VERSION: equipment.software.encode(),
        Did.DBC_SHA256: bytes.fromhex(dbc_sha256()),
        Did.PERIOD_NS: struct.pack(">Q", config.period_ns),
    }
