"""The equipment of an ECU: data from production and access to the ECU's surroundings. A reset does not change it."""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from can_bridge.uds.security import AccessKey
from can_bridge.uds.services import Did
from contract.config.tree import Config
from contract.controller.interface import Controller
from contract.release.checks import Bundle, dbc_sha256
from contract.release.signing import PublicKey
from contract.runtime.onnx_session import OnnxController

Log = Callable[..., None]
"""The function that logs an event, called with the event's name, its text line, and its fields."""


@dataclass(frozen=True, kw_only=True)
class Equipment:
    """The equipment of one ECU.

    Attributes:
        root: public key that verifies key lists.
        access: secret shared with the tester.
        random_bytes: returns the given number of unpredictable bytes.
        hardware: name of the hardware, which a bundle may require.
        controller_of: creates a bundle's controller; raises BundleError if it does not run on this computer.
    """

    root: PublicKey
    access: AccessKey = field(repr=False)
    random_bytes: Callable[[int], bytes]
    hardware: str = "generic"
    serial: str = "0"
    software: str = ""
    controller_of: Callable[[Bundle], Controller] = OnnxController.of
    log: Log = lambda event, line, **fields: None


def identification(equipment: Equipment, config: Config) -> Mapping[Did, bytes]:
    """Return the values of those UDS data identifiers that do not change while the ECU has power."""
    return {
        Did.SERIAL_NUMBER: equipment.serial.encode(),
        Did.HARDWARE: equipment.hardware.encode(),
        Did.SOFTWARE_VERSION: equipment.software.encode(),
        Did.DBC_SHA256: bytes.fromhex(dbc_sha256()),
        Did.PERIOD_NS: struct.pack(">Q", config.period_ns),
    }
