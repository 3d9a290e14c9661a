"""Which response answers which request: late and doubled ones must not pass for the answer to the next request."""

from typing import Final

from can_bridge.uds.fault_codes import CODE_BYTES
from can_bridge.uds.fault_reports import Report
from can_bridge.uds.services import Service

NEGATIVE: Final = 0x7F
POSITIVE: Final = 0x40
"""Added to a service's identifier in its response."""

_SAME: Final = {
    Service.SESSION: slice(1, 2),
    Service.RESET: slice(1, 2),
    Service.REPORT_FAULTS: slice(1, 2),
    Service.READ: slice(1, 3),
    Service.SECURITY: slice(1, 2),
    Service.COMMUNICATION: slice(1, 2),
    Service.WRITE: slice(1, 3),
    Service.ROUTINE: slice(1, 4),
    Service.TRANSFER: slice(1, 2),
    Service.TESTER_PRESENT: slice(1, 2),
    Service.FAULT_SETTING: slice(1, 2),
}
"""Bytes that a positive response repeats of its request: sub-function, identifier or block counter."""
_OF_ONE_CODE: Final = frozenset({Report.SNAPSHOT, Report.EXTENDED})
"""Reports of faults that repeat the code, too."""


def answers(request: bytes, response: bytes) -> bool:
    """Whether a response can be to this request."""
    if not request or not response:
        return False
    if response[0] == NEGATIVE:
        return len(response) >= 3 and response[1] == request[0]
    same = _SAME.get(Service(request[0])) if request[0] in Service.__members__.values() else None
    if request[0] == Service.REPORT_FAULTS and request[1] in _OF_ONE_CODE:
        same = slice(1, 2 + CODE_BYTES)
    return response[0] == request[0] + POSITIVE and (same is None or request[same] == response[same])
