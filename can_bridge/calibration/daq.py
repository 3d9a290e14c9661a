"""The measurement by XCP (DAQ): one list of values, which a tool defines, and one event, the end of a control period.

The values of the ECU's latest control period are in a memory area. A tool reads this area, or lets the ECU send parts
of it in a list. The tool allocates the list's frames (ODTs) and their entries, writes the address of each entry, and
starts the list. If frames of an earlier period are still waiting when a control period ends, the values of the
ended period are not sent. So all frames that are sent for one event have the values of one period.
"""

import struct
from enum import Enum
from math import copysign
from typing import Final

import numpy as np

from can_bridge.calibration.xcp import MAX_CTO, Denied, Error, deny_if
from can_bridge.wire.messages import SENSORS, Mode, Reason
from contract.arrays import Array
from contract.controller.calibration import PACKED_BYTES, Calibration

MEASURED_ADDRESS: Final = 0x2000_0100
"""The address at which a tool finds the memory area; the calibration segment ends before this address."""
_STATES: Final = struct.Struct("<3Bb")
MEASURED_BYTES: Final = 4 * SENSORS + 4 + _STATES.size + PACKED_BYTES
"""The size of the area in bytes: four for each floating-point value, one for each integer, and the calibration."""
MOST_ODTS: Final = 16
"""Largest number of frames per period: enough for all values of the area, one floating-point value per frame."""
MOST_ENTRIES: Final = 32
"""Largest number of entries in all frames of the list together."""
MOST_IN_ODT: Final = MAX_CTO - 1
"""Largest number of bytes in a frame after the byte with the frame's number."""
EVENT_NAME: Final = b"control period"
DYNAMIC: Final = 0x01
"""Properties of the DAQ: dynamic lists, no prescalers, no time stamps, frames that begin with their number."""
OF_DAQ: Final = 0x44
"""Properties of the event: it is for measurement, and all frames of a list have values of the same control period."""
_NO_BITS: Final = 0xFF
_SELECTED, _RUNNING = 0x01, 0x40


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


def cycle_of(period_ns: int) -> tuple[int, int]:
    """Return a period as one byte and the number of its unit; unit n is 10^n ns."""
    for unit in range(10):
        cycle = round(period_ns / 10**unit)
        if cycle < 256:
            return cycle, unit
    return 255, 9


_Stage = Enum("_Stage", "NOTHING FREED LISTS ODTS ENTRIES")
"""The stages of the allocation, whose commands have a fixed order (ASAM MCD-1 XCP, part 2)."""


class DaqLists:
    """The measurement list, and the values of the latest control period. Another thread may only call `sample`. The
    method of an XCP command has the command's name, and takes a packet of at least its shortest length. It returns the
    answer without its first byte, or None if this is the whole answer; it raises Denied to refuse the command."""

    def __init__(self, period_ns: int) -> None:
        self._cycle = cycle_of(period_ns)
        self._measured = bytes(MEASURED_BYTES)
        self._fresh: bytes | None = None
        self.free()

    def free(self) -> None:
        """Stop and delete the list."""
        self.is_running = self._is_selected = False
        self._stage = _Stage.NOTHING
        self._lists = 0
        self._odts: list[list[tuple[int, int]]] = []
        self._used = 0
        self._pointer: tuple[int, int] | None = None
        self._left: list[int] = []

    def sample(self, measured: bytes) -> None:
        """Store the values of a control period for `look`, unless frames of an earlier period are still to be sent."""
        if not self._left and not (self.is_running and self._fresh is not None):
            self._fresh = measured

    def look(self) -> None:
        """Take over the values that `sample` stored, if any, and queue their frames if the list is running."""
        fresh, self._fresh = self._fresh, None
        if fresh is not None:
            self._measured = fresh
            self._left = list(range(len(self._odts))) if self.is_running else []

    def packets(self, most: int) -> list[bytes]:
        """Return up to `most` of the frames still to be sent; frames without an entry are skipped."""
        found = list[bytes]()
        while self._left and len(found) < most:
            number = self._left.pop(0)
            pieces = [self._measured[at : at + size] for at, size in self._odts[number] if size]
            if pieces:
                found.append(bytes([number]) + b"".join(pieces))
        return found

    def read(self, address: int, length: int) -> bytes | None:
        """Return bytes of the memory area with the latest period's values; None for a range outside this area."""
        at = address - MEASURED_ADDRESS
        return self._measured[at : at + length] if 0 <= at <= at + length <= MEASURED_BYTES else None

    def free_daq(self, data: bytes) -> None:
        self.free()
        self._stage = _Stage.FREED

    def alloc_daq(self, data: bytes) -> None:
        self._check_stage(_Stage.FREED, _Stage.LISTS)
        count = _number(data, 2)
        deny_if(count > 1, Error.MEMORY_OVERFLOW)
        self._stage, self._lists = _Stage.LISTS, count

    def alloc_odt(self, data: bytes) -> None:
        self._check_stage(_Stage.LISTS, _Stage.ODTS)
        self._check_list(data)
        count = data[4]
        deny_if(count == 0, Error.OUT_OF_RANGE)
        deny_if(count > MOST_ODTS, Error.MEMORY_OVERFLOW)
        self._stage, self._odts = _Stage.ODTS, [[] for _ in range(count)]

    def alloc_odt_entry(self, data: bytes) -> None:
        """Allocate the entries of one frame; raises Denied if the frame has entries already."""
        self._check_stage(_Stage.ODTS, _Stage.ENTRIES)
        self._check_list(data)
        odt, count = data[4], data[5]
        deny_if(odt >= len(self._odts) or count == 0, Error.OUT_OF_RANGE)
        deny_if(bool(self._odts[odt]), Error.SEQUENCE)
        deny_if(self._used + count > MOST_ENTRIES, Error.MEMORY_OVERFLOW)
        self._stage, self._odts[odt] = _Stage.ENTRIES, [(0, 0)] * count
        self._used += count

    def set_daq_ptr(self, data: bytes) -> None:
        self._check_idle()
        self._check_list(data)
        odt, entry = data[4], data[5]
        deny_if(odt >= len(self._odts) or entry >= len(self._odts[odt]), Error.OUT_OF_RANGE)
        self._pointer = odt, entry

    def write_daq(self, data: bytes) -> None:
        """Write the entry at the pointer, and move the pointer to the frame's next entry."""
        self._check_idle()
        if self._pointer is None or self._pointer[1] >= len(self._odts[self._pointer[0]]):
            raise Denied(Error.SEQUENCE)
        bits, size, extension = data[1:4]
        deny_if(bits != _NO_BITS or not 0 < size <= MOST_IN_ODT or extension != 0, Error.OUT_OF_RANGE)
        at = int.from_bytes(data[4:8], "little") - MEASURED_ADDRESS
        deny_if(not 0 <= at <= at + size <= MEASURED_BYTES, Error.ACCESS_DENIED)
        odt, entry = self._pointer
        entries = self._odts[odt]
        deny_if(sum(other for _, other in entries) - entries[entry][1] + size > MOST_IN_ODT, Error.DAQ_CONFIG)
        entries[entry] = at, size
        self._pointer = odt, entry + 1

    def set_daq_list_mode(self, data: bytes) -> None:
        """Set the list's mode; the priority in the command is ignored."""
        self._check_idle()
        deny_if(data[1] != 0, Error.MODE_NOT_VALID)
        self._check_list(data)
        deny_if(_number(data, 4) != 0 or data[6] != 1, Error.OUT_OF_RANGE)

    def get_daq_list_mode(self, data: bytes) -> bytes:
        self._check_list(data)
        bits = (_SELECTED if self._is_selected else 0) | (_RUNNING if self.is_running else 0)
        event, prescaler, priority = 0, 1, 0
        return bytes([bits, 0, 0, event, 0, prescaler, priority])

    def start_stop_daq_list(self, data: bytes) -> bytes:
        self._check_list(data)
        deny_if(data[1] > 2, Error.MODE_NOT_VALID)
        if data[1] == 0:
            self._stop()
        elif not self._odts:
            raise Denied(Error.DAQ_CONFIG)
        elif data[1] == 1:
            self.is_running = True
        else:
            self._is_selected = True
        return bytes([0])

    def start_stop_synch(self, data: bytes) -> None:
        deny_if(data[1] > 2, Error.MODE_NOT_VALID)
        if data[1] == 0 or (data[1] == 2 and self._is_selected):
            self._stop()
        elif data[1] == 1 and self._is_selected:
            self.is_running = True
        self._is_selected = False

    def get_daq_processor_info(self, data: bytes) -> bytes:
        return bytes([DYNAMIC, self._lists, 0, 1, 0, 0, 0])  # one event

    def get_daq_resolution_info(self, data: bytes) -> bytes:
        return bytes([1, MOST_IN_ODT, 1, 0, 0, 0, 0])

    def get_daq_event_info(self, data: bytes) -> bytes:
        """Return the properties of the event; the tool reads the event's name by UPLOAD."""
        deny_if(_number(data, 2) != 0, Error.OUT_OF_RANGE)
        lists, priority = 1, 0
        return bytes([OF_DAQ, lists, len(EVENT_NAME), *self._cycle, priority])

    def _stop(self) -> None:
        self.is_running = False
        self._left = []

    def _check_stage(self, *stages: _Stage) -> None:
        deny_if(self._stage not in stages, Error.SEQUENCE)

    def _check_idle(self) -> None:
        deny_if(self.is_running, Error.DAQ_ACTIVE)

    def _check_list(self, data: bytes) -> None:
        deny_if(_number(data, 2) >= self._lists, Error.OUT_OF_RANGE)


def _number(data: bytes, at: int) -> int:
    return int.from_bytes(data[at : at + 2], "little")
