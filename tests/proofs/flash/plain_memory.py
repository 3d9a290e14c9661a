"""A place for two images and three records that never fails: fast, for measurements of what stands on it."""

from can_bridge.flashing.backing import Kind, Slot, Work
from can_bridge.flashing.medium import MediumError

_PIECES = 2
"""In which a slot is cleared, so that work on it takes longer than one call."""


class PlainMemory:
    """A `Backing` in Python's memory.

    Attributes:
        slots: the bytes of both images.
        kept: the records.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self.slots = {slot: bytearray() for slot in Slot}
        self.kept: dict[Kind, bytes] = {}

    @property
    def capacity(self) -> int:
        return self._capacity

    def records(self) -> dict[Kind, bytes]:
        return dict(self.kept)

    def keep(self, kind: Kind, record: bytes) -> None:
        self.kept[kind] = record

    def clear(self, slot: Slot) -> Work[None]:
        for _ in range(_PIECES):
            self.slots[slot].clear()
            yield

    def begin_again(self, slot: Slot, length: int) -> None:
        del self.slots[slot][length:]

    def append(self, slot: Slot, data: bytes) -> None:
        if len(self.slots[slot]) + len(data) > self._capacity:
            raise MediumError(f"slot {slot.name}: full", len(self.slots[slot]))
        self.slots[slot] += data

    def read(self, slot: Slot, offset: int, length: int) -> bytes:
        found = bytes(self.slots[slot][offset : offset + length])
        if len(found) != length:
            raise MediumError(f"slot {slot.name}: only {len(self.slots[slot])} bytes", offset)
        return found
