"""The interface from the store to its memory: a folder (`folder_backing`) or a chip's flash memory.

If the power fails during `keep`, the memory has either the old record or the whole new record. A loss of power never
deletes data that were written to a slot before the last `keep` of a `RecordKind.STATE`.
"""

from collections.abc import Generator, Mapping
from enum import IntEnum
from typing import Final, Protocol, TypeVar, cast

from contract.errors import BusError


class MediumError(BusError):
    """An error of the memory."""


T = TypeVar("T")
Long = Generator[None, None, T]
"""A generator that executes a long operation in parts. Between two parts the caller can answer frames or give up. A
part takes at most a few tens of milliseconds on a controller. The generator's return value is the result."""


def at_once(work: Long[T]) -> T:
    """Execute all parts of a long operation and return its result."""
    try:
        while True:
            next(work)
    except StopIteration as done:
        return cast(T, done.value)


MAX_RECORD: Final = 8192
"""Largest length of a record in bytes."""


class Slot(IntEnum):
    A = 0
    B = 1

    @property
    def other(self) -> "Slot":
        return Slot(1 - self)


class RecordKind(IntEnum):
    """The kinds of records that survive a loss of power; the newest record of each kind is valid."""

    STATE = 1
    KEYS = 2
    CALIBRATION = 3
    FAULTS = 4


class Backing(Protocol):
    """A memory for two images of up to `capacity` bytes, and four records. A method raises MediumError if it fails."""

    @property
    def capacity(self) -> int: ...

    def records(self) -> Mapping[RecordKind, bytes]:
        """Return the newest complete record of each kind; a kind is missing if it was never stored."""

    def keep(self, kind: RecordKind, record: bytes) -> None:
        """Replace the record of this kind; `record` has at most `MAX_RECORD` bytes."""

    def clear(self, slot: Slot, behind: int = 0) -> Long[None]:
        """Erase a slot in parts, from byte `behind` to the slot's end; `behind` is 0 or a result of `begin_again`."""

    def begin_again(self, slot: Slot, length: int) -> int:
        """Prepare a slot after power-on for data after its first `length` bytes. Returns the number of bytes that stay
        valid, fewer if the memory after them must be erased next. Raises MediumError if all bytes must be erased."""

    def append(self, slot: Slot, data: bytes) -> None:
        """Append data to the data written to a slot since its erasure. Also raises MediumError if the slot is full."""

    def read(self, slot: Slot, offset: int, length: int) -> bytes: ...
