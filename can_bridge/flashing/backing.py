"""What the store's logic needs of the place it lies in: here a folder (`folder_backing`), on a chip a flash memory.

A backing promises two things about a loss of power. `keep` is atomic: afterwards the record is the old one or the new
one. And whatever was written to a slot before the last `keep` of a `RecordKind.STATE` is still there.
"""

from collections.abc import Generator, Mapping
from enum import IntEnum
from typing import Final, Protocol, TypeVar, cast

from contract.errors import BusError


class MediumError(BusError):
    """The memory failed at `address`."""

    def __init__(self, message: str, address: int) -> None:
        super().__init__(message)
        self.address = address


T = TypeVar("T")

Long = Generator[None, None, T]
"""Long work in pieces: each `next` does one, of at most a few tens of milliseconds on a controller; the return value is
the result. Whoever drives it can answer the bus in between, and throws it away when the session ends."""


def at_once(work: Long[T]) -> T:
    """The result of all of it."""
    while True:
        try:
            next(work)
        except StopIteration as done:
            return cast(T, done.value)


MAX_RECORD: Final = 8192
"""Bytes of one record."""


class Slot(IntEnum):
    """Where an image lies."""

    A = 0
    B = 1

    @property
    def other(self) -> "Slot":
        return Slot(1 - self)


class RecordKind(IntEnum):
    """Kinds of records that outlive a loss of power; the newest of each counts."""

    STATE = 1
    KEYS = 2
    CALIBRATION = 3
    FAULTS = 4


class Backing(Protocol):
    """A place for two images and four records."""

    @property
    def capacity(self) -> int:
        """Bytes that a slot holds."""
        ...

    def records(self) -> Mapping[RecordKind, bytes]:
        """The newest whole record of each kind; missing where none was ever kept."""
        ...

    def keep(self, kind: RecordKind, record: bytes) -> None:
        """Replace a record, of at most `MAX_RECORD` bytes. Raises MediumError if no place is left that works."""
        ...

    def clear(self, slot: Slot, behind: int = 0) -> Long[None]:
        """Erase a slot, piece by piece, behind as many bytes as `begin_again` gave. Raises MediumError if it fails."""
        ...

    def begin_again(self, slot: Slot, length: int) -> int:
        """Go on, after power-on, behind the first `length` bytes of a slot; what was written behind them is void.
        Raises MediumError if it must be cleared as a whole. Returns `length`; or less, where the memory must first be
        cleared behind that many bytes."""
        ...

    def append(self, slot: Slot, data: bytes) -> None:
        """Write behind what was written to a slot since it was cleared. Raises MediumError if it does not fit."""
        ...

    def read(self, slot: Slot, offset: int, length: int) -> bytes:
        """Bytes that were appended; raises MediumError if the memory does not give them back."""
        ...
