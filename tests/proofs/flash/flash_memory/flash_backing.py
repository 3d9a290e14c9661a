"""The store's place in a flash memory: a log of records in the first sectors, images in a pool of the others.

An image takes sectors of the pool one after the other, each erased before the layout names it and named there before
anything is programmed into it. What a cut may have torn lies behind the last checkpoint; an image goes on behind that,
in the same sector, at a word that was certainly not touched. A sector that fails is recorded as bad; the image goes on
in another one.

Bytes that do not fill a word wait for those that do. `keep` of a `Kind.STATE` puts them into the log first, so that no
word has to be padded and a checkpoint may stand at any byte.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from can_bridge.flashing.backing import MAX_RECORD, Kind, Slot, Work
from can_bridge.flashing.medium import MediumError
from tests.can_bridge.flashing.medium import ERASED, WORD, WornOutError
from tests.proofs.flash.flash_memory.flash_layout import MAX_EXTENTS, Extent, Layout, Lies
from tests.proofs.flash.flash_memory.flash_log import FlashLog
from tests.proofs.flash.flash_memory.simulated_flash import SimulatedFlash

LOG_SECTORS: Final = 2
SPARE_SECTORS: Final = 2
"""Sectors of the pool that replace bad ones and what interrupted transfers leave unused; no slot's capacity."""
_LAYOUT: Final = 16
"""Kind of the record that has the layout; the store's own kinds are below it."""


class FlashBacking:
    """A `Backing` in a `SimulatedFlash`; writes nothing when made."""

    def __init__(self, medium: SimulatedFlash, *, log_sectors: int = LOG_SECTORS) -> None:
        """Find what is there.

        Args:
            medium: the memory, all of it.
            log_sectors: so many at its beginning have the records, 2 or more.

        Raises:
            ValueError: the memory has too few sectors for a slot of one each.
            BusError: the layout is another version's.
        """
        self._medium = medium
        self._pool = range(log_sectors, medium.sectors)
        self._needed = (len(self._pool) - SPARE_SECTORS) // 2
        if self._needed < 1:
            raise ValueError(
                f"flash of {medium.sectors} sectors: must have {log_sectors + SPARE_SECTORS + 2} or more for two slots"
            )
        self._log = FlashLog(medium, range(log_sectors))
        kept = self._log.records.get(_LAYOUT)
        self._layout = Layout(cursor=self._pool.start) if kept is None else Layout.decode(kept)
        self._lies: list[Lies] = list(self._layout.slots)
        # Where the next word goes; unknown after power-on, before `clear` or `begin_again`.
        self._next: dict[Slot, int | None] = {}

    @property
    def capacity(self) -> int:
        """Bytes that a slot holds."""
        return self._needed * self._medium.sector_size

    def records(self) -> Mapping[Kind, bytes]:
        """The newest whole record of each kind."""
        return {kind: self._log.records[kind] for kind in Kind if kind in self._log.records}

    def keep(self, kind: Kind, record: bytes) -> None:
        """Replace a record; a checkpoint (`Kind.STATE`) keeps what waits for a whole word, too.

        Raises:
            ValueError: the record is too long.
            MediumError: no place is left that works.
        """
        if len(record) > MAX_RECORD:
            raise ValueError(f"record of {len(record)} bytes: must have at most {MAX_RECORD}")
        if kind == Kind.STATE and self._tails_changed():
            self._keep_layout()
        self._log.keep(kind, record)

    def clear(self, slot: Slot) -> Work[None]:
        """Forget an image, and erase as many sectors as a slot needs, one at a time.

        Raises MediumError if so many sectors that work are not left.
        """
        self._lies[slot] = Lies()
        self._next[slot] = None
        self._keep_layout()
        yield
        while len(self._layout.fresh) < self._needed:
            self._erase_one()
            yield
        self._keep_layout()
        self._next[slot] = 0

    def begin_again(self, slot: Slot, length: int) -> None:
        """Go on behind the first `length` bytes.

        Raises MediumError if so many are not there, or after too many interruptions: the slot has to be cleared then.
        """
        lies = self._lies[slot]
        if self._next.get(slot) is not None and length == lies.tail_at + len(lies.tail):
            # No supply was lost since: a tester that only began again costs no extent.
            return
        kept = tuple(extent for extent in lies.extents if extent.offset < length)
        in_tail = lies.tail_at < length <= lies.tail_at + len(lies.tail)
        tail = lies.tail[: length - lies.tail_at] if in_tail else b""
        start = length - len(tail)
        if start:
            self.read(slot, start - 1, 1)
        place = self._untouched(lies.extents, kept[-1].address) if kept else None
        if len(kept) >= MAX_EXTENTS:
            raise MediumError(f"slot {slot.name}: interrupted {MAX_EXTENTS} times: clear it and begin again", 0)
        if place is not None:
            kept = (*(extent for extent in kept if extent.offset < start), Extent(start, place))
        self._lies[slot] = Lies(kept, start, tail)
        self._next[slot] = place or 0
        self._keep_layout()

    def append(self, slot: Slot, data: bytes) -> None:
        """Write behind what was written since the slot was cleared.

        Raises:
            MediumError: it does not fit, no sector that works is left, or the slot was not prepared since power-on.
        """
        lies = self._lies[slot]
        if self._next.get(slot) is None:
            raise MediumError(f"slot {slot.name}: clear it, or begin again, before writing to it", 0)
        if lies.tail_at + len(lies.tail) + len(data) > self.capacity:
            raise MediumError(f"slot {slot.name}: holds {self.capacity} bytes, no more fit", 0)
        waiting = lies.tail + data
        whole = len(waiting) // WORD * WORD
        done = 0
        while done < whole:
            done += self._program(slot, waiting[done:whole])
        self._lies[slot] = replace(self._lies[slot], tail=waiting[whole:])

    def read(self, slot: Slot, offset: int, length: int) -> bytes:
        """Bytes that were appended; raises MediumError if they are not there, or torn."""
        lies = self._lies[slot]
        parts, at, end = [], offset, offset + length
        while at < end:
            if lies.tail_at <= at < lies.tail_at + len(lies.tail):
                piece = lies.tail[at - lies.tail_at :][: end - at]
            else:
                before_tail = lies.tail_at if lies.tail and at < lies.tail_at else end
                piece = self._read(slot, at, min(end, before_tail) - at)
            parts.append(piece)
            at += len(piece)
        return b"".join(parts)

    def _read(self, slot: Slot, at: int, length: int) -> bytes:
        """From the extent in which a byte lies, as much as it has."""
        extents = self._lies[slot].extents
        number = sum(extent.offset <= at for extent in extents) - 1
        if number < 0:
            raise MediumError(f"slot {slot.name}: nothing was written at byte {at}", 0)
        extent = extents[number]
        place = extent.address + at - extent.offset
        there = self._medium.sector_size - extent.address % self._medium.sector_size - (at - extent.offset)
        if number + 1 < len(extents):
            there = min(there, extents[number + 1].offset - at)
        if there <= 0:
            raise MediumError(f"slot {slot.name}: nothing was written at byte {at}", place)
        return self._medium.read(place, min(length, there))

    def _program(self, slot: Slot, data: bytes) -> int:
        """Program some of these words; returns how many bytes. A sector that fails is left for another."""
        lies, size = self._lies[slot], self._medium.sector_size
        place = self._next[slot] or 0
        if place % size == 0:
            place = self._take(slot) * size
            lies = self._lies[slot]
        piece = data[: size - place % size]
        try:
            self._medium.program(place, piece)
            written = self._medium.read(place, len(piece)) == piece
        except MediumError:
            written = False
        if not written:
            # The words before this piece stay where they are: they were read back.
            self._layout = replace(self._layout, bad=self._layout.bad | {place // size})
            self._next[slot] = 0
            return 0
        self._next[slot] = place + len(piece)
        self._lies[slot] = replace(lies, tail_at=lies.tail_at + len(piece), tail=b"")
        return len(piece)

    def _take(self, slot: Slot) -> int:
        """A fresh sector for the next bytes of an image, named in the layout before it is used."""
        lies = self._lies[slot]
        if len(lies.extents) >= MAX_EXTENTS:
            raise MediumError(f"slot {slot.name}: interrupted {MAX_EXTENTS} times: clear it and begin again", 0)
        if not self._layout.fresh:
            self._erase_one()
        sector = min(self._layout.fresh, key=self._from_cursor)
        extents = tuple(extent for extent in lies.extents if extent.offset < lies.tail_at)
        taken = Extent(lies.tail_at, sector * self._medium.sector_size)
        self._lies[slot] = replace(lies, extents=(*extents, taken))
        self._layout = replace(self._layout, fresh=self._layout.fresh - {sector}, cursor=sector + 1)
        self._keep_layout()
        return sector

    def _erase_one(self) -> None:
        """Make one more sector fresh; one that cannot be erased is bad."""
        used = {extent.address // self._medium.sector_size for lies in self._lies for extent in lies.extents}
        free = set(self._pool) - used - self._layout.bad - self._layout.fresh
        while free:
            sector = min(free, key=self._from_cursor)
            try:
                self._medium.erase(sector)
            except WornOutError:
                free.discard(sector)
                self._layout = replace(self._layout, bad=self._layout.bad | {sector})
                continue
            self._layout = replace(self._layout, fresh=self._layout.fresh | {sector}, cursor=sector + 1)
            return
        raise MediumError("flash: no sector is left that can be erased: replace the ECU", 0)

    def _from_cursor(self, sector: int) -> int:
        return (sector - self._layout.cursor) % self._medium.sectors

    def _untouched(self, extents: tuple[Extent, ...], within: int) -> int | None:
        """The first word of a sector that is certainly as erased, behind all extents in it; None if it is full.

        The last cut may have left a weak word that looks erased: behind the last one that does not, or, if nothing was
        programmed since, where the last extent begins.
        """
        size = self._medium.sector_size
        sector = within // size
        begun = max(extent.address for extent in extents if extent.address // size == sector)
        place = (sector + 1) * size - WORD
        while place >= begun and self._looks_erased(place):
            place -= WORD
        place = max(place + 2 * WORD, begun + WORD)
        return place if place < (sector + 1) * size and sector not in self._layout.bad else None

    def _looks_erased(self, place: int) -> bool:
        try:
            return self._medium.read(place, WORD) == ERASED
        except MediumError:
            return False

    def _tails_changed(self) -> bool:
        """Whether bytes wait for a whole word that the layout in the log does not have."""
        return any(now.tail and now != kept for now, kept in zip(self._lies, self._layout.slots, strict=True))

    def _keep_layout(self) -> None:
        self._layout = replace(self._layout, slots=(self._lies[0], self._lies[1]))
        self._log.keep(_LAYOUT, self._layout.encode())
