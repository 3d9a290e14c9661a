"""The store's place in a folder, for an ECU with a file system: a file for each record and each slot.

A record is replaced by a temporary file that is synchronised before it takes the name, and the folder after it. Slots
are appended to; a checkpoint (`Kind.STATE`) synchronises what was appended before it is written itself.
"""

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from can_bridge.flashing.backing import MAX_RECORD, Kind, Slot, Work
from can_bridge.flashing.folder_files import FolderFiles
from can_bridge.flashing.medium import MediumError

CAPACITY: Final = 16 * 1024 * 1024
"""Bytes of a slot where nothing else is asked for: more than any release."""
_HEADER: Final = struct.Struct(">4sII")
_MAGIC: Final = b"SWR1"
_TEMPORARY: Final = "record.new"


class FolderBacking:
    """A `Backing` in a folder, made if it is not there. One process at a time may use it."""

    def __init__(self, folder: Path, *, files: FolderFiles | None = None, capacity: int = CAPACITY) -> None:
        """Open it. Raises MediumError if the folder cannot be made.

        Args:
            folder: where the files are.
            files: access to them in place of the system's.
            capacity: bytes of a slot.
        """
        self._files = FolderFiles(folder) if files is None else files
        self._capacity = capacity
        self._unsynced: set[Slot] = set()
        # Unknown after power-on, before `clear` or `begin_again`.
        self._written: dict[Slot, int] = {}

    @property
    def capacity(self) -> int:
        """Bytes that a slot holds."""
        return self._capacity

    def records(self) -> Mapping[Kind, bytes]:
        """The record of each kind whose file is whole."""
        found = {kind: self._record(kind) for kind in Kind}
        return {kind: record for kind, record in found.items() if record is not None}

    def keep(self, kind: Kind, record: bytes) -> None:
        """Replace a record; a checkpoint (`Kind.STATE`) synchronises the slots first. Raises ValueError if the record
        is too long; MediumError if the disk is full, or refuses."""
        if len(record) > MAX_RECORD:
            raise ValueError(f"record of {len(record)} bytes: must have at most {MAX_RECORD}")
        if kind == Kind.STATE:
            for slot in sorted(self._unsynced):
                self._files.sync(_slot_file(slot))
                self._files.sync_folder()
            self._unsynced.clear()
        self._files.replace(_TEMPORARY, _HEADER.pack(_MAGIC, len(record), zlib.crc32(record)) + record)
        self._files.sync(_TEMPORARY)
        self._files.rename(_TEMPORARY, _record_file(kind))
        self._files.sync_folder()

    def clear(self, slot: Slot, behind: int = 0) -> Work[None]:
        """Empty a slot's file; `begin_again` asks for no part of one."""
        assert behind == 0
        self._written.pop(slot, None)
        self._files.replace(_slot_file(slot), b"")
        yield
        self._files.sync(_slot_file(slot))
        self._files.sync_folder()
        self._written[slot] = 0

    def begin_again(self, slot: Slot, length: int) -> int:
        """Cut a slot's file off behind `length` bytes; raises MediumError if it has fewer."""
        there = self._files.size(_slot_file(slot))
        if there < length:
            raise MediumError(f"slot {slot.name}: {there} bytes are there, must be {length} or more", there)
        if there:
            self._files.truncate(_slot_file(slot), length)
        self._written[slot] = length
        return length

    def append(self, slot: Slot, data: bytes) -> None:
        """Write behind what was written since the slot was cleared. Raises MediumError if it does not fit, the disk is
        full, or the slot was not prepared since power-on."""
        if slot not in self._written:
            raise MediumError(f"slot {slot.name}: clear it, or begin again, before writing to it", 0)
        if self._written[slot] + len(data) > self._capacity:
            raise MediumError(f"slot {slot.name}: holds {self._capacity} bytes, no more fit", self._capacity)
        before = self._written.pop(slot)
        self._unsynced.add(slot)
        self._files.append(_slot_file(slot), data)
        self._written[slot] = before + len(data)

    def read(self, slot: Slot, offset: int, length: int) -> bytes:
        """Bytes that were appended; raises MediumError if they are not there."""
        found = self._files.read(_slot_file(slot), offset, length) or b""
        if len(found) != length:
            raise MediumError(f"slot {slot.name}: nothing was written at byte {offset + len(found)}", offset)
        return found

    def _record(self, kind: Kind) -> bytes | None:
        raw = self._files.read(_record_file(kind))
        if raw is None or len(raw) < _HEADER.size:
            return None
        magic, length, crc = _HEADER.unpack_from(raw)
        record = raw[_HEADER.size :]
        return record if (magic, length, crc) == (_MAGIC, len(record), zlib.crc32(record)) else None


def _record_file(kind: Kind) -> str:
    return f"{kind.name.lower()}.record"


def _slot_file(slot: Slot) -> str:
    return f"slot_{slot.name.lower()}.image"
