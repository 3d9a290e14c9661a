"""What services 0x14 and 0x19 answer of the fault memory (ISO 14229-1): codes by status, snapshots, ages."""

import struct
from collections.abc import Collection
from enum import IntEnum
from typing import Final

from can_bridge.uds.fault_codes import CODE_BYTES, CODES, J2012_FORMAT, REASONS, SNAPSHOT_FORMATS
from can_bridge.uds.fault_memory import AVAILABLE, FaultMemory
from can_bridge.uds.refused import Refused
from can_bridge.uds.services import Nrc
from can_bridge.wire.messages import Reason

ALL_GROUPS: Final = 0xFFFFFF
RECORD: Final = 0x01
"""Number of a code's one snapshot, and of its one extended record, which holds the age."""
_ALL_RECORDS: Final = 0xFF


class Report(IntEnum):
    """Sub-functions of service 0x19."""

    COUNT = 0x01
    BY_STATUS = 0x02
    SNAPSHOT = 0x04
    EXTENDED = 0x06
    SUPPORTED = 0x0A


LENGTHS: Final = {Report.COUNT: 1, Report.BY_STATUS: 1, Report.SNAPSHOT: 4, Report.EXTENDED: 4, Report.SUPPORTED: 0}
"""Bytes behind the sub-function."""


def report(memory: FaultMemory, kind: Report, option: bytes) -> bytes:
    """What follows the sub-function in the answer; raises Refused for an unknown code or record."""
    if kind in (Report.SNAPSHOT, Report.EXTENDED):
        return _record(memory, kind, REASONS.get(int.from_bytes(option[:CODE_BYTES], "big")), option[-1])
    mask = option[0] & AVAILABLE if option else None
    found = [
        CODES[reason].to_bytes(CODE_BYTES, "big") + bytes([fault.status])
        for reason, fault in memory.faults.items()
        if mask is None or fault.status & mask
    ]
    if kind is Report.COUNT:
        return bytes([AVAILABLE, J2012_FORMAT]) + len(found).to_bytes(2, "big")
    return bytes([AVAILABLE]) + b"".join(found)


def cleared(group: int) -> Collection[Reason]:
    """Which faults a group of codes names: all, or one; raises Refused for others."""
    if group == ALL_GROUPS:
        return CODES.keys()
    if group not in REASONS:
        raise Refused(Nrc.OUT_OF_RANGE)
    return (REASONS[group],)


def _record(memory: FaultMemory, kind: Report, reason: Reason | None, number: int) -> bytes:
    if reason is None or number not in (RECORD, _ALL_RECORDS):
        raise Refused(Nrc.OUT_OF_RANGE)
    fault = memory.faults[reason]
    answer = CODES[reason].to_bytes(CODE_BYTES, "big") + bytes([fault.status])
    if not fault.snapshot:
        return answer
    answer += bytes([RECORD])
    if kind is Report.EXTENDED:
        return answer + bytes([fault.age])
    answer += bytes([len(SNAPSHOT_FORMATS)])
    at = 0
    for identifier, form in SNAPSHOT_FORMATS.items():
        size = struct.calcsize(form)
        answer += identifier.to_bytes(2, "big") + fault.snapshot[at : at + size]
        at += size
    return answer
