"""A CAN frame, its priority and its possible lengths."""

from dataclasses import dataclass
from typing import Final

from contract.config.diagnosis import MOST_EXTENDED, MOST_STANDARD, CanId

MAX_FRAME_ID: Final = MOST_STANDARD
"""Largest 11-bit identifier."""
MAX_EXTENDED_ID: Final = MOST_EXTENDED
"""Largest 29-bit identifier. No message of our DBC has such an identifier; diagnosis and other traffic may."""

CLASSIC_LENGTHS: Final = tuple(range(9))
FD_LENGTHS: Final = (*CLASSIC_LENGTHS, 12, 16, 20, 24, 32, 48, 64)
"""Data lengths in bytes that a CAN FD length code can state (ISO 11898-1:2015, data length code)."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A data frame; CAN FD frames use the data bit rate. Raises ValueError for a wrong identifier, length or time.

    Attributes:
        frame_id: 11 bits, or 29 bits if the identifier is extended; the smaller identifier wins arbitration.
        data: 0 to 8 bytes; in a CAN FD frame, a length from `FD_LENGTHS`.
        timestamp_ns: time of sending or reception in ns, on the clock of the sender or receiver.
    """

    frame_id: int
    data: bytes
    timestamp_ns: int = 0
    is_fd: bool = True
    is_extended: bool = False

    def __post_init__(self) -> None:
        largest = MAX_EXTENDED_ID if self.is_extended else MAX_FRAME_ID
        if not 0 <= self.frame_id <= largest:
            raise ValueError(f"frame id {self.frame_id:#x}: must be in 0..{largest:#x}")
        if not isinstance(self.data, bytes):
            raise ValueError(f"frame data is {type(self.data).__name__}: must be bytes")
        lengths = FD_LENGTHS if self.is_fd else CLASSIC_LENGTHS
        if len(self.data) not in lengths:
            kind = "CAN FD" if self.is_fd else "classic CAN"
            raise ValueError(f"frame of {len(self.data)} bytes: {kind} allows only {', '.join(map(str, lengths))}")
        if self.timestamp_ns < 0:
            raise ValueError(f"timestamp {self.timestamp_ns} ns: must not be negative")

    @property
    def identifier(self) -> CanId:
        return CanId(self.frame_id, self.is_extended)


Priority = tuple[int, bool, int]
"""Priority of a frame; the smaller value wins arbitration."""


def priority(frame: Frame) -> Priority:
    """Return the priority, in the order of the bits on the bus: the identifier's first 11 bits, then SRR and IDE, which
    are recessive in a 29-bit format, then the last 18 bits. The data have no effect on the priority."""
    if frame.is_extended:
        return frame.frame_id >> 18, True, frame.frame_id & 0x3FFFF
    return frame.frame_id, False, 0
