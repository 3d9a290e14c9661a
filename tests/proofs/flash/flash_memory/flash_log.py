"""Records in sectors of a flash memory, of which the newest of each kind counts; a cut leaves the old or the new one.

A record is a header of one word, and its payload padded to words:

    0   4  "SWL1"
    4   1  kind
    8   4  generation of the sector
    12  4  bytes of payload
    16  4  CRC-32 of the payload
    28  4  CRC-32 of bytes 0 to 27

The payload's CRC is what commits a record: it is right only when the last word is. A header that is right reserves its
payload's place, even where that was cut short, so that no payload is ever read as a header.

A full sector is followed by the next one of the ring: it is erased, takes the newest of each kind, and counts from its
last word on, a record of kind `_OPEN`; the sector of the greatest generation is the log. Sectors wear evenly that way.

After power-on, the word behind the last one that was touched may be weak, so it is left out. Where two cuts in a row
left two such words, the second is found by reading back: each record is, and is written again behind itself if it is
not what was written.
"""

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from can_bridge.flashing.medium import MediumError
from tests.can_bridge.flashing.medium import ERASED, WORD
from tests.proofs.flash.flash_memory.simulated_flash import SimulatedFlash

_MAGIC: Final = b"SWL1"
_HEADER: Final = struct.Struct(">4sB3xIII8x")
_OPEN: Final = 0
_RETRIES: Final = 3
"""Writings of a record in one sector before the next one is taken."""


@dataclass(eq=False)
class _Found:
    """What a sector holds."""

    records: dict[int, bytes] = field(default_factory=dict)
    is_open: bool = False
    generation: int = 0
    end: int = 0
    """Word from which on it is certainly as erased."""


class FlashLog:
    """Reads the log when made; writes nothing before the first `keep`."""

    def __init__(self, medium: SimulatedFlash, sectors: Sequence[int]) -> None:
        """Find the newest records.

        Args:
            medium: the memory.
            sectors: of it, two or more, that are the log's alone.

        Raises:
            ValueError: fewer than two sectors.
        """
        if len(sectors) < 2:
            raise ValueError(f"flash log in {len(sectors)} sectors: must have 2 or more")
        self._medium = medium
        self._ring = tuple(sectors)
        self._words = medium.sector_size // WORD
        found = {sector: self._scan(sector) for sector in sectors}
        opened = [sector for sector in sectors if found[sector].is_open]
        self._sector = max(opened, key=lambda sector: found[sector].generation, default=None)
        newest = _Found() if self._sector is None else found[self._sector]
        self._records, self._generation, self._end = newest.records, newest.generation, newest.end

    @property
    def records(self) -> Mapping[int, bytes]:
        """The newest of each kind."""
        return self._records

    def keep(self, kind: int, record: bytes) -> None:
        """Replace the record of a kind, which is in 1..255.

        Raises:
            MediumError: all records together do not fit into a sector, or no sector is left that works.
        """
        for _ in range(_RETRIES):
            # One word is left out: the last word of a full sector could not be distinguished from a weak one.
            if self._sector is None or self._end + _words_of(record) >= self._words:
                break
            if self._write(self._sector, kind, record):
                self._records[kind] = record
                return
        self._move({**self._records, kind: record})

    def _move(self, records: dict[int, bytes]) -> None:
        """Go on in the next sector that works, with these records."""
        needed = sum(map(_words_of, records.values())) + 2
        if needed > self._words:
            raise MediumError(
                f"flash log: records of {needed * WORD} bytes: must fit into a sector of {self._medium.sector_size}", 0
            )
        start = 0 if self._sector is None else self._ring.index(self._sector) + 1
        generation = self._generation + 1
        for step in range(len(self._ring)):
            sector = self._ring[(start + step) % len(self._ring)]
            if sector == self._sector:
                break
            if self._fill(sector, generation, records):
                self._sector, self._generation, self._records = sector, generation, records
                return
        raise MediumError("flash log: no sector is left that can be written: replace the ECU", 0)

    def _fill(self, sector: int, generation: int, records: Mapping[int, bytes]) -> bool:
        before = self._end, self._generation
        try:
            self._medium.erase(sector)
        except MediumError:
            return False
        self._end, self._generation = 0, generation
        if all(self._write(sector, kind, record) for kind, record in (*records.items(), (_OPEN, b""))):
            return True
        self._end, self._generation = before
        return False

    def _write(self, sector: int, kind: int, record: bytes) -> bool:
        """Whether it stands there now; `_end` is behind it in any case."""
        head = _HEADER.pack(_MAGIC, kind, self._generation, len(record), zlib.crc32(record))[: WORD - 4]
        padded = record + bytes(-len(record) % WORD)
        # The header is read back first: without one that is right, no payload may follow.
        for part in (head + struct.pack(">I", zlib.crc32(head)), padded):
            address = sector * self._medium.sector_size + self._end * WORD
            self._end += len(part) // WORD
            try:
                self._medium.program(address, part)
                if self._medium.read(address, len(part)) != part:
                    return False
            except MediumError:
                return False
        return True

    def _scan(self, sector: int) -> _Found:
        found = _Found()
        base = sector * self._medium.sector_size
        content = self._words_in(base)
        word = 0
        while word < self._words:
            head = content[word]
            if head != ERASED:
                found.end = word + 1
            length = _payload_length(head)
            word += 1
            if length is None or word + -(-length // WORD) > self._words:
                continue
            _, kind, generation, _, crc = _HEADER.unpack(head[: _HEADER.size])
            payload = self._read(base + word * WORD, length)
            word += -(-length // WORD)
            found.end = word
            if payload is not None and zlib.crc32(payload) == crc:
                found.records[kind] = payload
                found.generation = max(found.generation, generation)
        found.is_open = found.records.pop(_OPEN, None) is not None
        found.end += 1
        return found

    def _words_in(self, base: int) -> list[bytes]:
        """The words of a sector; b"" for each that cannot be read."""
        whole = self._read(base, self._medium.sector_size)
        if whole is not None:
            return [whole[at : at + WORD] for at in range(0, len(whole), WORD)]
        return [self._read(base + at, WORD) or b"" for at in range(0, self._medium.sector_size, WORD)]

    def _read(self, address: int, length: int) -> bytes | None:
        try:
            return self._medium.read(address, length)
        except MediumError:
            return None


def _words_of(record: bytes) -> int:
    return 1 + -(-len(record) // WORD)


def _payload_length(head: bytes) -> int | None:
    """Bytes of payload of the record that begins with this word; None if none does."""
    if head[:4] != _MAGIC or zlib.crc32(head[: WORD - 4]) != int.from_bytes(head[WORD - 4 :], "big"):
        return None
    return int(_HEADER.unpack(head[: _HEADER.size])[3])
