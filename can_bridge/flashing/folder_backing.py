"""A store's memory in a folder, for an ECU with a file system: a file for each record and each slot.

To replace a record, a temporary file is written, synchronised and renamed. Then the folder is synchronised.
"""

import errno
import os
import stat
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from can_bridge.flashing.backing import MAX_RECORD, Long, MediumError, RecordKind, Slot


class FolderFiles:
    """The files of one folder, accessed by name; every method raises MediumError if the system reports an error."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        with _reported(folder):
            folder.mkdir(parents=True, exist_ok=True)

    def read(self, name: str, offset: int = 0, length: int | None = None) -> bytes | None:
        """Return bytes of a file, fewer if the file ends earlier; None if there is no such file."""
        path = self._folder / name
        with _reported(path), suppress(FileNotFoundError), os.fdopen(open_regular(path, os.O_RDONLY), "rb") as file:
            file.seek(offset)
            return file.read(length)
        return None

    def size(self, name: str) -> int:
        """Return the size of a file in bytes; 0 if there is no such file."""
        with _reported(self._folder / name), suppress(FileNotFoundError):
            return (self._folder / name).stat().st_size
        return 0

    def append(self, name: str, data: bytes) -> None:
        self._write(name, os.O_WRONLY | os.O_CREAT | os.O_APPEND, data)

    def replace(self, name: str, data: bytes) -> None:
        self._write(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, data)

    def truncate(self, name: str, length: int) -> None:
        with _reported(self._folder / name):
            os.truncate(self._folder / name, length)

    def rename(self, old: str, new: str) -> None:
        with _reported(self._folder / old):
            (self._folder / old).replace(self._folder / new)

    def sync_folder(self) -> None:
        self.sync("")

    def sync(self, name: str) -> None:
        """Wait until the file's content is on the disk."""
        with _reported(self._folder / name):
            handle = os.open(self._folder / name, os.O_RDONLY | os.O_NONBLOCK)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)

    def _write(self, name: str, flags: int, data: bytes) -> None:
        with _reported(self._folder / name), os.fdopen(open_regular(self._folder / name, flags), "wb") as file:
            file.write(data)


def open_regular(path: Path, flags: int) -> int:
    """Return the handle of a file; only the owner can access a new file. Raises OSError if the file is not regular."""
    handle = os.open(path, flags | os.O_NONBLOCK, 0o600)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, "must be a regular file", path)
    return handle


@contextmanager
def _reported(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise MediumError(f"store {path}: {error.strerror or error}") from error


CAPACITY: Final = 16 * 1024 * 1024
"""Default size of a slot in bytes; every release is smaller."""
_HEADER: Final = struct.Struct(">4sII")
_MAGIC: Final = b"SWR1"
_TEMPORARY: Final = "record.new"


class FolderBacking:
    """A `Backing` in a folder, which is created if it does not exist. Only one process at a time may use the folder."""

    def __init__(self, folder: Path, *, files: FolderFiles | None = None, capacity: int = CAPACITY) -> None:
        """Open the folder, with access through `files`. Raises MediumError if the folder cannot be created."""
        self._files = FolderFiles(folder) if files is None else files
        self.capacity = capacity
        self._unsynced: set[Slot] = set()
        # The length of the data in a slot is unknown after power-on, until `clear` or `begin_again` is called.
        self._written: dict[Slot, int] = {}

    def records(self) -> Mapping[RecordKind, bytes]:
        found = {}
        for kind in RecordKind:
            raw = self._files.read(_record_file(kind)) or b""
            if raw == _framed(record := raw[_HEADER.size :]):
                found[kind] = record
        return found

    def keep(self, kind: RecordKind, record: bytes) -> None:
        """Replace a record; for `RecordKind.STATE`, sync the slots first. Raises ValueError for an overlong record."""
        if len(record) > MAX_RECORD:
            raise ValueError(f"the record has {len(record)} bytes: must have at most {MAX_RECORD}")
        if kind == RecordKind.STATE:
            for slot in sorted(self._unsynced):
                self._files.sync(_slot_file(slot))
                self._files.sync_folder()
            self._unsynced.clear()
        self._files.replace(_TEMPORARY, _framed(record))
        self._files.sync(_TEMPORARY)
        self._files.rename(_TEMPORARY, _record_file(kind))
        self._files.sync_folder()

    def clear(self, slot: Slot, behind: int = 0) -> Long[None]:
        """Empty a slot's file. `behind` must be 0, because `begin_again` of this class always keeps all bytes."""
        assert behind == 0
        self._written.pop(slot, None)
        self._files.replace(_slot_file(slot), b"")
        yield
        self._files.sync(_slot_file(slot))
        self._files.sync_folder()
        self._written[slot] = 0

    def begin_again(self, slot: Slot, length: int) -> int:
        """Truncate a slot's file to `length` bytes; raises MediumError if the file has fewer bytes."""
        there = self._files.size(_slot_file(slot))
        if there < length:
            raise MediumError(f"slot {slot.name} has {there} bytes: must have {length} or more")
        if there:
            self._files.truncate(_slot_file(slot), length)
        self._written[slot] = length
        return length

    def append(self, slot: Slot, data: bytes) -> None:
        """See `Backing.append`. Also raises MediumError if the slot was not prepared since power-on."""
        if slot not in self._written:
            raise MediumError(f"slot {slot.name} is not prepared: clear it, or announce its image again")
        if self._written[slot] + len(data) > self.capacity:
            raise MediumError(f"slot {slot.name} has room for only {self.capacity} bytes")
        before = self._written.pop(slot)
        self._unsynced.add(slot)
        self._files.append(_slot_file(slot), data)
        self._written[slot] = before + len(data)

    def read(self, slot: Slot, offset: int, length: int) -> bytes:
        found = self._files.read(_slot_file(slot), offset, length) or b""
        if len(found) != length:
            raise MediumError(f"slot {slot.name}: nothing was written at byte {offset + len(found)}")
        return found


def _framed(record: bytes) -> bytes:
    return _HEADER.pack(_MAGIC, len(record), zlib.crc32(record)) + record


def _record_file(kind: RecordKind) -> str:
    return f"{kind.name.lower()}.record"


def _slot_file(slot: Slot) -> str:
    return f"slot_{slot.name.lower()}.image"
