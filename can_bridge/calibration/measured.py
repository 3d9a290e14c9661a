"""The ECU's latest control period as a piece of memory: what a measurement tool reads, or has sent in each period."""

import struct
from typing import Final

import numpy as np

from can_bridge.wire.messages import SENSORS, Mode, Reason
from contract.arrays import Array
from contract.controller.calibration import PACKED_BYTES, Calibration

MEASURED_ADDRESS: Final = 0x2000_0100
"""Where it lies for a tool: behind the calibration."""
_STATES: Final = struct.Struct("<4B")
MEASURED_BYTES: Final = 4 * SENSORS + 4 + _STATES.size + PACKED_BYTES
"""Four of a value in floating point, one of a number of a state, and the whole calibration."""


def measured_bytes(
    pressures: Array, command: float, *, mode: Mode, reason: Reason, gated: int, calibration: Calibration
) -> bytes:
    """Pack a control period, little-endian.

    Args:
        pressures: Cp of each sensor in the row that was planned on, an estimate in place of a sensor that is set aside.
        command: jet flow rate that was sent, in U_inf W.
        gated: what the command gate had to do, bits of `can_bridge.command_gate.Intervention`.
        calibration: in force in this period.
    """
    floats = np.array([*pressures[:SENSORS], command], np.float64).astype("<f4")
    return floats.tobytes() + _STATES.pack(mode, reason, gated, 0) + calibration.pack()
