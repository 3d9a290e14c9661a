"""From control periods to the fault memory: when a fault begins to stand, when control begins, and how it was then."""

import struct
from typing import Final

import numpy as np

from can_bridge.uds.fault_codes import CODES
from can_bridge.uds.fault_memory import FaultMemory
from can_bridge.wire.messages import COUNT_LIMIT, SENSORS
from ecu.ecu_state import EcuState
from ecu.fail_safe import OperatingMode

_NUMBERS: Final = struct.Struct(">IBHH")
_MOST_MS: Final = 0xFFFF_FFFF


class FaultWatch:
    """Looks at every control period from power-on, and notes the few that matter."""

    def __init__(self, memory: FaultMemory) -> None:
        self._memory = memory
        self._power_on_ns: int | None = None

    def seen(self, before: EcuState, after: EcuState, now_ns: int) -> None:
        """After one more control period."""
        is_first, now_ns = self._power_on_ns is None, max(0, now_ns)
        self._power_on_ns = now_ns if self._power_on_ns is None else self._power_on_ns
        was, now = before.fail_safe.mode, after.fail_safe.mode
        if now is was and not is_first:
            return
        if now is OperatingMode.CONTROL:
            self._memory.note(None)
        elif now is OperatingMode.FAULT and after.fail_safe.reason in CODES:
            self._memory.note(after.fail_safe.reason, _snapshot(before, after, now_ns - self._power_on_ns))


def _snapshot(before: EcuState, after: EcuState, since_power_on_ns: int) -> bytes:
    """What is kept of this moment, in the order of `SNAPSHOT_FORMATS`."""
    return (
        _NUMBERS.pack(
            min(max(0, since_power_on_ns) // 1_000_000, _MOST_MS),
            before.fail_safe.mode.on_wire,
            min(after.missed, COUNT_LIMIT),
            min(after.overruns, COUNT_LIMIT),
        )
        + before.memory.window[-1, :SENSORS].astype(np.dtype(">f4")).tobytes()
    )
