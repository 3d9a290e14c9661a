"""A backing in memory that keeps no more than `Backing` promises, and can lose its power in any call."""

import random
from collections.abc import Mapping
from dataclasses import dataclass, field

from can_bridge.flashing.backing import MAX_RECORD, Long, MediumError, RecordKind, Slot


class UnreadableError(MediumError):
    """What a cut left half written: on a chip, a bus fault."""


class PowerCut(BaseException):
    """Raised by a memory that plays a loss of supply; what was under way is torn, and no handler may go on."""


CLEAR_PIECES = 3


@dataclass
class Memory:
    """What outlives a loss of power."""

    records: dict[RecordKind, bytes] = field(default_factory=dict)
    slots: dict[Slot, bytearray | None] = field(default_factory=lambda: {Slot.A: None, Slot.B: None})
    """None: being cleared, or never cleared; nothing can be read or appended."""
    safe: dict[Slot, int] = field(default_factory=lambda: {Slot.A: 0, Slot.B: 0})
    """Bytes written before the last `keep` of a state."""


class PlainBacking:
    """A memory from one power-on to the next.

    Args:
        memory: of earlier lives.
        capacity: of each slot, in bytes.
        cut_at: number of the writing call, from 0, in which the power goes.
        seed: decides what a cut call still does, and what is left of bytes that nothing made safe.
    """

    def __init__(
        self, memory: Memory | None = None, *, capacity: int = 200_000, cut_at: int | None = None, seed: int = 0
    ) -> None:
        self.memory = Memory() if memory is None else memory
        self.calls = 0
        self.broken = False
        """Whether every writing call fails."""
        self.capacity = capacity
        self._cut_at = cut_at
        self._random = random.Random(seed)
        self._writable: set[Slot] = set()

    def after_power_on(self, *, cut_at: int | None = None, seed: int = 0) -> "PlainBacking":
        """The next life: what was not made safe is lost, in part or wholly, or was written all the same."""
        memory = self.memory
        for slot, content in memory.slots.items():
            if content is not None and len(content) > memory.safe[slot]:
                left = self._random.randint(memory.safe[slot], len(content))
                memory.slots[slot] = content[:left] + self._random.randbytes(self._random.choice([0, 100]))
        return PlainBacking(memory, capacity=self.capacity, cut_at=cut_at, seed=seed)

    def content(self, slot: Slot | None) -> bytes:
        """All that was appended to a slot and is still there."""
        assert slot is not None
        return bytes(self.memory.slots[slot] or b"")

    def records(self) -> Mapping[RecordKind, bytes]:
        return dict(self.memory.records)

    def keep(self, kind: RecordKind, record: bytes) -> None:
        assert len(record) <= MAX_RECORD
        self._call(lambda: self._keep(kind, record))

    def clear(self, slot: Slot, behind: int = 0) -> Long[None]:
        self._writable.discard(slot)
        for _ in range(CLEAR_PIECES):
            self._call(lambda: self._clear(slot, None))
            yield
        self._call(lambda: self._clear(slot, bytearray()))
        self._writable.add(slot)

    def begin_again(self, slot: Slot, length: int) -> int:
        content = self.memory.slots[slot]
        assert content is not None, "never cleared"
        assert length <= len(content), "these bytes were never written"
        del content[length:]
        self._writable.add(slot)
        return length

    def append(self, slot: Slot, data: bytes) -> None:
        content = self.memory.slots[slot]
        assert slot in self._writable and content is not None, "written without clear or begin_again"
        if len(content) + len(data) > self.capacity:
            raise MediumError("full", len(content))
        part = data[: self._random.randint(0, len(data))]
        self._call(lambda: content.extend(data), lambda: content.extend(part))

    def read(self, slot: Slot, offset: int, length: int) -> bytes:
        content = self.memory.slots[slot]
        if content is None or offset + length > len(content):
            raise UnreadableError("nothing there", offset)
        return bytes(content[offset : offset + length])

    def _keep(self, kind: RecordKind, record: bytes) -> None:
        self.memory.records[kind] = record
        if kind == RecordKind.STATE:
            for slot, content in self.memory.slots.items():
                self.memory.safe[slot] = 0 if content is None else len(content)

    def _clear(self, slot: Slot, content: bytearray | None) -> None:
        self.memory.slots[slot], self.memory.safe[slot] = content, 0

    def _call(self, whole, torn=None) -> None:
        if self.broken:
            raise MediumError("worn out", 0)
        if self.calls == self._cut_at:
            # Nothing, part, or all of it was done.
            done = self._random.choice([None, torn, whole])
            if done is not None:
                done()
            raise PowerCut
        self.calls += 1
        whole()
