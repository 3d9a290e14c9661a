"""The diagnostic trouble codes of this ECU (SAE J2012-DA), and the snapshots. Each `Reason` that is a fault has a code.

The first two bytes of a code are a letter, a 1 (which marks a manufacturer's own code), and the number of the `Reason`.
The letter is U for faults of the bus, P for faults of the ECU and its sensors. The third byte is the type of failure.
"""

import struct
from collections.abc import Mapping
from enum import IntEnum
from typing import Final

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
_LETTERS: Final = "PCBU"


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


SNAPSHOT_FORMATS: Final[Mapping[Snapshot, str]] = {
    Snapshot.TIME_MS: ">I",
    Snapshot.MODE_BEFORE: ">B",
    Snapshot.MISSED: ">H",
    Snapshot.OVERRUNS: ">H",
    Snapshot.PRESSURES_CP: f">{SENSORS}f",
}
"""Formats of a snapshot's values, in the order in which they are stored."""
SNAPSHOT_BYTES: Final = sum(struct.calcsize(form) for form in SNAPSHOT_FORMATS.values())


def in_letters(code: int) -> str:
    """Return a code as workshops write it, for example U1101-87."""
    return f"{_LETTERS[code >> 22]}{code >> 8 & 0x3FFF:04X}-{code & 0xFF:02X}"
