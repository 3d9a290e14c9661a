"""A backing in memory that refuses what `Backing` does not promise; `tests/proofs/flash` cuts a folder's supply."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from can_bridge.flashing.backing import MAX_RECORD, Long, MediumError, RecordKind, Slot

CLEAR_PIECES = 4


@dataclass
class PlainBacking:
    """A memory from one power-on to the next; `kept` and `slots` outlive a loss of power, and a slot is None until it
    is cleared. `calls` counts writing calls, all of which fail if `broken`; `written` counts bytes, and `on_written` is
    called with the slot's length after each block."""

    capacity: int = 200_000
    kept: dict[RecordKind, bytes] = field(default_factory=dict)
    slots: dict[Slot, bytearray | None] = field(default_factory=lambda: dict.fromkeys(Slot))
    calls: int = 0
    broken: bool = False
    written: int = 0
    on_written: Callable[[int], None] = lambda received: None
    _writable: set[Slot] = field(default_factory=set)

    def after_power_on(self) -> "PlainBacking":
        return replace(self, _writable=set())

    def content(self, slot: Slot) -> bytes:
        return bytes(self.slots[slot] or b"")

    def records(self) -> Mapping[RecordKind, bytes]:
        return dict(self.kept)

    def keep(self, kind: RecordKind, record: bytes) -> None:
        assert len(record) <= MAX_RECORD
        self._count()
        self.kept[kind] = record

    def clear(self, slot: Slot, behind: int = 0) -> Long[None]:
        self._writable.discard(slot)
        for _ in range(CLEAR_PIECES - 1):
            self._count()
            self.slots[slot] = None
            yield
        self._count()
        self.slots[slot] = bytearray()
        self._writable.add(slot)

    def begin_again(self, slot: Slot, length: int) -> int:
        content = self.slots[slot]
        assert content is not None, "never cleared"
        assert length <= len(content), "these bytes were never written"
        del content[length:]
        self._writable.add(slot)
        return length

    def append(self, slot: Slot, data: bytes) -> None:
        content = self.slots[slot]
        assert slot in self._writable and content is not None, "written without clear or begin_again"
        if len(content) + len(data) > self.capacity:
            raise MediumError("full")
        self._count()
        content += data
        self.written += len(data)
        self.on_written(len(content))

    def read(self, slot: Slot, offset: int, length: int) -> bytes:
        content = self.slots[slot]
        if content is None or offset + length > len(content):
            raise MediumError("nothing there")
        return bytes(content[offset : offset + length])

    def _count(self) -> None:
        if self.broken:
            raise MediumError("worn out")
        self.calls += 1
