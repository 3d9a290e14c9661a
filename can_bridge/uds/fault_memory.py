"""The trouble codes of this ECU, and its fault memory: for each code its status (ISO 14229-1, annex D), its age and one
snapshot. Each `Reason` that is a fault has a code.

The first two bytes of a code (SAE J2012-DA) are a letter (U for faults of the bus, P for faults of the ECU and its
sensors), a 1, which marks a manufacturer's own code, and the number of the `Reason`. The third is the type of failure.

The ECU's state machine debounces faults: a fault's test fails in the period in which the fault begins, and all tests
pass in the period in which control begins. An operation cycle lasts from power-on to the next reset. A confirmed fault
is cleared after `AGED_CYCLES` cycles in which its test passed and did not fail. The record survives resets. Its format,
with lengths in bytes:

    "SWF1" (4); for each code, in the order of `CODES`: status (1), age (1), 1 with a snapshot (1), snapshot; CRC-32 (4)

The record is written only while no jet can run, and only if it differs from the stored record. In a cycle it is written
at most once for each code that fails, once when tests first pass, and once when codes are cleared.
"""

import struct
import zlib
from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Final

from can_bridge.flashing.backing import MediumError
from can_bridge.uds.services import Nrc, Refused
from can_bridge.wire.messages import SENSORS, Reason

_P: Final = 0x110000
_U: Final = 0xD10000
CODES: Final[Mapping[Reason, int]] = {
    reason: letter | reason << 8 | failure
    for reason, letter, failure in (
        (Reason.STREAM_LOST, _U, 0x87),  # missing message
        (Reason.STREAM_INVALID, _U, 0x81),  # invalid serial data received
        (Reason.DEADLINE, _P, 0x92),  # performance or incorrect operation
        (Reason.BUS_OFF, _U, 0x88),  # bus off
        (Reason.INTERNAL, _P, 0x04),  # system internal failure
        (Reason.SENSOR_INVALID, _P, 0x86),  # signal invalid
        (Reason.STALE, _U, 0x82),  # not updated
        (Reason.NOT_AUTHENTIC, _U, 0x83),  # value of signal protection calculation incorrect
        (Reason.CLOCK, _P, 0x04),
        (Reason.IMPLAUSIBLE, _P, 0x64),  # signal plausibility failure
        (Reason.OTHER_ECU, _U, 0x94),  # unexpected operation
        (Reason.NO_RELEASE, _P, 0x51),  # not programmed
        (Reason.NOT_HELPING, _P, 0x92),
        (Reason.NO_SPEED, _U, 0x87),
    )
}
"""Trouble codes of three bytes. A reason that has no code is not a fault."""
REASON_BY_CODE: Final[Mapping[int, Reason]] = {code: reason for reason, code in CODES.items()}
CODE_BYTES: Final = 3
J2012_FORMAT: Final = 0x00
"""Number of this code format in the answer to service 19 01."""


class Snapshot(IntEnum):
    """The identifiers of a snapshot's values. A snapshot is taken when a fault is found; service 22 cannot read it."""

    TIME_MS = 0xFD20
    """Time in ms since power-on, 4 bytes."""
    MODE_BEFORE = 0xFD21
    """`Mode` in the previous control period, 1 byte."""
    MISSED = 0xFD22
    """Number of control periods without usable pressures since power-on, at most 65535, 2 bytes."""
    OVERRUNS = 0xFD23
    """Number of skipped control periods since power-on, at most 65535, 2 bytes."""
    PRESSURES_CP = 0xFD24
    """Pressure coefficients in the newest row of the previous period, as float32, 4 bytes each."""


SNAPSHOT_FORMATS: Final = dict(zip(Snapshot, (">I", ">B", ">H", ">H", f">{SENSORS}f"), strict=True))
"""Formats of a snapshot's values, in the order in which they are stored."""
SNAPSHOT_BYTES: Final = sum(struct.calcsize(form) for form in SNAPSHOT_FORMATS.values())


def in_letters(code: int) -> str:
    """Return a code as workshops write it, for example U1101-87."""
    return f"{'PCBU'[code >> 22]}{code >> 8 & 0x3FFF:04X}-{code & 0xFF:02X}"


AGED_CYCLES: Final = 40
_MAGIC: Final = b"SWF1"
_FAULT: Final = struct.Struct(f">BBB{SNAPSHOT_BYTES}s")
_CRC: Final = struct.Struct(">I")


class Status(IntFlag):
    """The bits of a trouble code's status; bit 7, the warning lamp, is not supported."""

    TEST_FAILED = 0x01
    FAILED_THIS_CYCLE = 0x02
    PENDING = 0x04
    CONFIRMED = 0x08
    NOT_COMPLETED_SINCE_CLEAR = 0x10
    FAILED_SINCE_CLEAR = 0x20
    NOT_COMPLETED_THIS_CYCLE = 0x40


AVAILABLE: Final = 0x7F
_S = Status
_AT_FAILURE: Final = _S.TEST_FAILED | _S.FAILED_THIS_CYCLE | _S.PENDING | _S.CONFIRMED | _S.FAILED_SINCE_CLEAR
_UNTESTED: Final = _S.NOT_COMPLETED_SINCE_CLEAR | _S.NOT_COMPLETED_THIS_CYCLE


@dataclass(frozen=True)
class KeptFault:
    """The stored state of one code.

    Attributes:
        age: number of operation cycles in which the test of a confirmed fault passed and did not fail, since its last
            failure.
        snapshot: snapshot of the first failure in the latest cycle with a failure; empty without a snapshot.
    """

    status: Status = _UNTESTED
    age: int = 0
    snapshot: bytes = b""

    def failed(self, snapshot: bytes) -> "KeptFault":
        is_first = not self.status & _S.FAILED_THIS_CYCLE
        return KeptFault((self.status | _AT_FAILURE) & ~_UNTESTED, 0, snapshot if is_first else self.snapshot)

    def passed(self) -> "KeptFault":
        return KeptFault(self.status & ~(_S.TEST_FAILED | _UNTESTED), self.age, self.snapshot)

    def next_cycle(self) -> "KeptFault":
        status, age, snapshot = self.status, self.age, self.snapshot
        if not status & (_S.FAILED_THIS_CYCLE | _S.NOT_COMPLETED_THIS_CYCLE):
            status &= ~_S.PENDING
            age = age + 1 if status & _S.CONFIRMED else 0
            if age >= AGED_CYCLES:
                status, age, snapshot = status & ~_S.CONFIRMED, 0, b""
        status = status & ~(_S.TEST_FAILED | _S.FAILED_THIS_CYCLE) | _S.NOT_COMPLETED_THIS_CYCLE
        return KeptFault(status, age, snapshot)

    def packed(self) -> bytes:
        """Return the fault as bytes of the record. Status bits without effect after a power-on have a fixed value."""
        status = self.status & ~_S.TEST_FAILED
        if not status & (_S.PENDING | _S.CONFIRMED):
            status |= _S.NOT_COMPLETED_THIS_CYCLE
        return _FAULT.pack(status, self.age, bool(self.snapshot), self.snapshot)


class FaultMemory:
    """The memory from one power-on to the next. Only `note` may be called by another thread.

    Args:
        record: the stored record; a damaged record counts as no record.
        keep: stores a record; raises MediumError.
        refusal: returns the reason why nothing may be written now, or None.

    Attributes:
        faults: the state of all codes, in the order of `CODES`.
        is_on: whether test results are recorded (service 0x85).
    """

    def __init__(
        self,
        record: bytes = b"",
        *,
        keep: Callable[[bytes], None] = lambda record: None,
        refusal: Callable[[], Nrc | None] = lambda: None,
    ) -> None:
        self._kept, self._keep, self._refusal = record, keep, refusal
        self.faults = {reason: fault.next_cycle() for reason, fault in decode(record).items()}
        self._noted: deque[tuple[Reason | None, bytes]] = deque(maxlen=64)
        self._is_changed = False
        self.is_on = True

    def note(self, reason: Reason | None, snapshot: bytes = b"") -> None:
        """Note that the test for `reason` failed now. If `reason` is None, note that all tests passed."""
        self._noted.append((reason, snapshot))

    def settle(self) -> None:
        """Evaluate the noted results, and store the record if allowed now; raises MediumError once if this fails."""
        while self._noted and (self.is_on or len(self._noted) > 1):
            # While recording is off, only the latest result stays queued. It is evaluated when recording resumes.
            reason, snapshot = self._noted.popleft()
            if not self.is_on:
                continue
            if reason is None:
                self.faults = {each: fault.passed() for each, fault in self.faults.items()}
            else:
                self.faults[reason] = self.faults[reason].failed(snapshot)
            self._is_changed = True
        if self._is_changed and self._refusal() is None:
            self._is_changed = False
            self._keep_if_different()

    def clear(self, reasons: Collection[Reason]) -> None:
        """Clear faults; raises Refused while nothing may be written, or if the memory fails."""
        if (code := self._refusal()) is not None:
            raise Refused(code)
        self.faults |= dict.fromkeys(reasons, KeptFault())
        try:
            self._keep_if_different()
        except MediumError as error:
            raise Refused(Nrc.PROGRAMMING_FAILURE, str(error)) from error

    def _keep_if_different(self) -> None:
        if (record := encode(self.faults)) != self._kept:
            self._keep(record)
            self._kept = record


def encode(faults: Mapping[Reason, KeptFault]) -> bytes:
    raw = _MAGIC + b"".join(faults[reason].packed() for reason in CODES)
    return raw + _CRC.pack(zlib.crc32(raw))


def decode(record: bytes) -> dict[Reason, KeptFault]:
    """Return the states of all codes in a record; states without a fault if it is damaged or no ECU writes it."""
    body, crc = record[len(_MAGIC) : -_CRC.size], record[-_CRC.size :]
    is_whole = record[: len(_MAGIC)] == _MAGIC and crc == _CRC.pack(zlib.crc32(record[: -_CRC.size]))
    if not is_whole or len(body) != _FAULT.size * len(CODES):
        return {reason: KeptFault() for reason in CODES}
    rows = _FAULT.iter_unpack(body)
    return {
        reason: KeptFault(Status(status & AVAILABLE), age, snapshot if has_one else b"")
        for reason, (status, age, has_one, snapshot) in zip(CODES, rows, strict=True)
    }


ALL_GROUPS: Final = 0xFFFFFF
RECORD: Final = 0x01
"""Number of a code's only snapshot, and of its only extended data record, which has the age."""
_ALL_RECORDS: Final = 0xFF


class FaultReport(IntEnum):
    """A sub-function of service 0x19."""

    COUNT = 0x01
    BY_STATUS = 0x02
    SNAPSHOT = 0x04
    EXTENDED = 0x06
    SUPPORTED = 0x0A


LENGTHS: Final = dict(zip(FaultReport, (1, 1, 4, 4, 0), strict=True))
"""Number of bytes that follow the sub-function in a request."""


def report(memory: FaultMemory, kind: FaultReport, option: bytes) -> bytes:
    """Return the answer's bytes after the sub-function; raises Refused for an unknown code or record."""
    if kind in (FaultReport.SNAPSHOT, FaultReport.EXTENDED):
        return _record(memory, kind, REASON_BY_CODE.get(int.from_bytes(option[:CODE_BYTES], "big")), option[-1])
    mask = option[0] & AVAILABLE if option else None
    found = [
        CODES[reason].to_bytes(CODE_BYTES, "big") + bytes([fault.status])
        for reason, fault in memory.faults.items()
        if mask is None or fault.status & mask
    ]
    if kind is FaultReport.COUNT:
        return bytes([AVAILABLE, J2012_FORMAT]) + len(found).to_bytes(2, "big")
    return bytes([AVAILABLE]) + b"".join(found)


def cleared(group: int) -> Collection[Reason]:
    """Return the faults in a group: `ALL_GROUPS`, or a single code. Raises Refused for an unknown code."""
    if group == ALL_GROUPS:
        return CODES.keys()
    if group not in REASON_BY_CODE:
        raise Refused(Nrc.OUT_OF_RANGE)
    return (REASON_BY_CODE[group],)


def _record(memory: FaultMemory, kind: FaultReport, reason: Reason | None, number: int) -> bytes:
    if reason is None or number not in (RECORD, _ALL_RECORDS):
        raise Refused(Nrc.OUT_OF_RANGE)
    fault = memory.faults[reason]
    answer = CODES[reason].to_bytes(CODE_BYTES, "big") + bytes([fault.status])
    if not fault.snapshot:
        return answer
    answer += bytes([RECORD])
    if kind is FaultReport.EXTENDED:
        return answer + bytes([fault.age])
    answer += bytes([len(SNAPSHOT_FORMATS)])
    at = 0
    for identifier, form in SNAPSHOT_FORMATS.items():
        size = struct.calcsize(form)
        answer += identifier.to_bytes(2, "big") + fault.snapshot[at : at + size]
        at += size
    return answer
