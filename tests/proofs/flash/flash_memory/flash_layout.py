"""Where the images lie in a flash memory: a value that is kept in the log, whole, before anything relies on it.

An image is a row of extents. Each begins at a byte of the image and at a place in the memory, and goes on until the
next one begins; none reaches over the end of its sector.
"""

import struct
from dataclasses import dataclass, field
from typing import Final

from can_bridge.flashing.backing import Slot
from contract.errors import BusError

MAX_EXTENTS: Final = 200
"""Extents of one slot: every interrupted transfer and every new sector needs one."""
_HEAD: Final = struct.Struct(">BHHH")
_SLOT: Final = struct.Struct(">HIB")
_EXTENT: Final = struct.Struct(">II")
_SECTOR: Final = struct.Struct(">H")
_VERSION: Final = 1


@dataclass(frozen=True)
class Extent:
    """Bytes of an image from `offset` on, at `address` of the memory."""

    offset: int
    address: int


@dataclass(frozen=True)
class Lies:
    """Where one image lies.

    Attributes:
        extents: by offset.
        tail_at: offset of the tail.
        tail: the last bytes that did not fill a word, kept in the log until they do.
    """

    extents: tuple[Extent, ...] = ()
    tail_at: int = 0
    tail: bytes = b""


@dataclass(frozen=True)
class Layout:
    """The use of the whole memory.

    Attributes:
        slots: by slot.
        fresh: sectors that were wholly erased and hold no extent.
        bad: sectors that are no longer used.
        cursor: sector from which on the next one is looked for, so that all wear alike.
    """

    slots: tuple[Lies, Lies] = field(default_factory=lambda: (Lies(), Lies()))
    fresh: frozenset[int] = frozenset()
    bad: frozenset[int] = frozenset()
    cursor: int = 0

    def encode(self) -> bytes:
        parts = [_HEAD.pack(_VERSION, len(self.fresh), len(self.bad), self.cursor)]
        parts += [_SECTOR.pack(sector) for sector in (*sorted(self.fresh), *sorted(self.bad))]
        for lies in self.slots:
            parts.append(_SLOT.pack(len(lies.extents), lies.tail_at, len(lies.tail)) + lies.tail)
            parts += [_EXTENT.pack(extent.offset, extent.address) for extent in lies.extents]
        return b"".join(parts)

    @classmethod
    def decode(cls, raw: bytes) -> "Layout":
        """What `encode` made; raises BusError for anything else."""
        try:
            version, fresh, bad, cursor = _HEAD.unpack_from(raw)
            if version != _VERSION:
                raise BusError(f"flash: the layout is of version {version}, this program reads {_VERSION}")
            at = _HEAD.size
            sectors = [_SECTOR.unpack_from(raw, at + _SECTOR.size * n)[0] for n in range(fresh + bad)]
            at += _SECTOR.size * len(sectors)
            slots = []
            for _ in Slot:
                count, tail_at, tail = _SLOT.unpack_from(raw, at)
                at += _SLOT.size + tail
                extents = [Extent(*_EXTENT.unpack_from(raw, at + _EXTENT.size * n)) for n in range(count)]
                slots.append(Lies(tuple(extents), tail_at, raw[at - tail : at]))
                at += _EXTENT.size * count
        except struct.error as error:
            raise BusError(f"flash: the layout of {len(raw)} bytes ends too early") from error
        return cls((slots[0], slots[1]), frozenset(sectors[:fresh]), frozenset(sectors[fresh:]), cursor)
