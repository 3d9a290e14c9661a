"""The values of the ECU's latest control period as a memory area, which a measurement tool reads or receives."""

import struct
from math import copysign
from typing import Final

import numpy as np

from can_bridge.wire.messages import SENSORS, Mode, Reason
from contract.arrays import Array
from contract.controller.calibration import PACKED_BYTES, Calibration

MEASURED_ADDRESS: Final = 0x2000_0100
"""The address at which a tool finds the area; the area is after the calibration segment."""
_STATES: Final = struct.Struct("<3Bb")
MEASURED_BYTES: Final = 4 * SENSORS + 4 + _STATES.size + PACKED_BYTES
"""The size of the area in bytes: four for each floating-point value, one for each state number, and the calibration."""


def measured_bytes(
    pressures: Array,
    command: float,
    *,
    mode: Mode,
    reason: Reason,
    gated: int,
    calibration: Calibration,
    correction: float = 1.0,
) -> bytes:
    """Pack the values of a control period, little-endian.

    Args:
        pressures: Cp of each sensor in the row from which the controller planned; for an excluded sensor, an estimate.
        command: jet flow rate that was sent, in U_inf W.
        gated: interventions of the command gate, as bits of `can_bridge.command_gate.Intervention`.
        calibration: the values in force in this period.
        correction: speed in use divided by the speed on the bus; packed as its difference from 1 in thousandths.
    """
    floats = np.array([*pressures[:SENSORS], command], np.float64).astype("<f4")
    exact = (correction - 1.0) * 1000.0
    thousandths = min(max(int(exact + copysign(0.5, exact)), -127), 127)
    return floats.tobytes() + _STATES.pack(mode, reason, gated, thousandths) + calibration.pack()
