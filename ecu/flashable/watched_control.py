"""Data that diagnosis gets from the control periods: the vehicle's requests for control, and the faults."""

import struct
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np

from can_bridge.uds.fault_memory import CODES, FaultMemory
from can_bridge.uds.services import Nrc
from can_bridge.wire.messages import COUNT_LIMIT, SENSORS, Reason
from ecu.ecu_state import EcuState
from ecu.fail_safe import OperatingMode

REMEMBERED_NS: Final = 1_000_000_000
"""Time in ns for which a request for control prevents programming, even if the bus is lost or a sensor fails."""


@dataclass(frozen=True, kw_only=True)
class VehicleRequest:
    """The time in ns of the latest step with a request for control, or None, and whether the jets may run now."""

    asked_ns: int | None = None
    drives_jets: bool = False

    def seen(self, before: EcuState, after: EcuState, now_ns: int) -> Self:
        asks = after.missed == before.missed and after.fail_safe.enable_request
        return replace(self, asked_ns=now_ns if asks else self.asked_ns, drives_jets=after.fail_safe.mode.drives_jets)

    def refusal(self, now_ns: int) -> Nrc | None:
        """Return CONDITIONS_NOT_CORRECT while the jets may run and until `REMEMBERED_NS` after a request, else None."""
        asks = self.asked_ns is not None and now_ns - self.asked_ns < REMEMBERED_NS
        return Nrc.CONDITIONS_NOT_CORRECT if self.drives_jets or asks else None


class FaultWatch:
    """A detector of faults in all control periods since power-on."""

    def __init__(self, memory: FaultMemory) -> None:
        self._memory = memory
        self._power_on_ns: int | None = None

    def seen(self, before: EcuState, after: EcuState, now_ns: int) -> None:
        is_first, now_ns = self._power_on_ns is None, max(0, now_ns)
        self._power_on_ns = now_ns if self._power_on_ns is None else self._power_on_ns
        was, now, fail_safe = before.fail_safe.mode, after.fail_safe.mode, after.fail_safe
        # If control begins again and its first step fails, a fault ends and another begins in the same period. Only
        # then is a period counted neither as missed (it has usable pressures) nor as good.
        fails_again = fail_safe.reason is Reason.INTERNAL and fail_safe.misses == fail_safe.good == 0
        if now is was and not is_first and not fails_again:
            return
        if now is OperatingMode.CONTROL:
            self._memory.note(None)
        elif now is OperatingMode.FAULT and fail_safe.reason in CODES:
            self._memory.note(fail_safe.reason, _snapshot(before, after, now_ns - self._power_on_ns))


def _snapshot(before: EcuState, after: EcuState, since_power_on_ns: int) -> bytes:
    """Return the snapshot of the state in which a fault was found, with values in the order of `SNAPSHOT_FORMATS`."""
    time_ms = min(max(0, since_power_on_ns) // 1_000_000, 0xFFFF_FFFF)
    counts = min(after.missed, COUNT_LIMIT), min(after.overruns, COUNT_LIMIT)
    cp = before.memory.window[-1, :SENSORS].astype(np.dtype(">f4"))
    return struct.pack(">IBHH", time_ms, before.fail_safe.mode.on_wire, *counts) + cp.tobytes()
