"""What an ECU says of itself when a tester reads it, but for its store and its calibration."""

import struct
from collections.abc import Mapping

from can_bridge.uds.services import Did
from contract.config.tree import Config
from contract.release.bundle import dbc_sha256
from firmware_sim.ecu.flashable.supplies import Supplies


def facts(supplies: Supplies, config: Config) -> Mapping[Did, bytes]:
    """Identifiers whose values do not change while the ECU has power."""
    return {
        Did.SERIAL_NUMBER: supplies.serial.encode(),
        Did.HARDWARE: supplies.hardware.encode(),
        Did.SOFTWARE_VERSION: supplies.software.encode(),
        Did.DBC_SHA256: bytes.fromhex(dbc_sha256()),
        Did.PERIOD_NS: struct.pack(">Q", config.period_ns),
    }
