"""The store in C and the Python store, which is its specification, side by side: the same calls, the same answers.

The supply of the C store may go in any operation of its flash memory. What is then found must be a state that the
Python store passes through in the call that was cut, and the Python store goes on from there.
"""

from collections.abc import Callable, Generator
from typing import Any, Final

from can_bridge.flashing import report, state
from can_bridge.flashing.backing import MAX_RECORD, Long, MediumError, RecordKind, Slot, at_once
from can_bridge.flashing.state import Level
from can_bridge.flashing.store import OutOfOrderError, Store
from contract.errors import ConfigError, KeyFileError
from tests.proofs.loader_in_c.store_library import NEVER, RULES, RUNNABLE, SECTOR, SETTINGS, SLOT_BYTES, WORD, Library

DONE, MORE = range(2)
FIRST_RECORD: Final = WORD - 2 * SECTOR  # where it is, from slot A on
_CODES: Final = {OutOfOrderError: 3, KeyFileError: 4, MediumError: 5, ConfigError: 2}
"""How the C store answers what the Python store raises."""


class PowerCut(BaseException):
    """A loss of supply in an operation of the memory; no handler of the store may go on."""


class MismatchError(AssertionError):
    """Both stores differ, or a promise is broken; `kind` is "mismatches", "bricked", "confirmed_lost" or "unsigned"."""

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(f"{kind}: {text}")
        self.kind = kind


def _place(slot: Slot, at: int) -> int:
    """Where a byte of a slot is in the memory, behind two sectors of records."""
    return 2 * SECTOR + slot * SLOT_BYTES + at


class Flash:
    """The `Backing` of the Python store, as a flash memory behaves: an image goes on where its words are blank.

    Its bytes are its own. Which words are blank, or cannot be read, is a fact of the memory below the C store.
    """

    capacity = SLOT_BYTES

    def __init__(self, memory: Any, unreadable: Any) -> None:
        self.kept: dict[RecordKind, bytes] = {}
        self.passed: list[tuple[RecordKind, bytes]] = []
        """Every record that was kept in the call under way, in order."""
        self.content = {slot: bytearray(b"\xff" * SLOT_BYTES) for slot in Slot}
        self.is_worn, self.records_left, self.erases = False, NEVER, True
        self._at = dict.fromkeys(Slot, 0)
        self._memory, self._unreadable = memory, unreadable

    def records(self) -> dict[RecordKind, bytes]:
        return dict(self.kept)

    def keep(self, kind: RecordKind, record: bytes) -> None:
        if not self.records_left:
            raise MediumError("no place is left")
        self.records_left -= 1
        self.passed.append((kind, record))
        self.kept[kind] = record

    def clear(self, slot: Slot, behind: int = 0) -> Long[None]:
        for at in range(behind, SLOT_BYTES, SECTOR):
            yield
            if not self.erases:
                raise MediumError("a sector is worn")
            self.content[slot][at : at + SECTOR] = b"\xff" * SECTOR
        self._at[slot] = behind

    def begin_again(self, slot: Slot, length: int) -> int:
        whole = state.decode(self.kept[RecordKind.STATE]).slots[slot].length
        begin, end = _place(slot, length // WORD * WORD), _place(slot, -(-whole // WORD) * WORD)
        if length < whole and (self._memory[begin:end].strip(b"\xff") or self._fails(begin, end)):
            length = length // SECTOR * SECTOR
            if not length:
                raise MediumError("the first sector has words too many")
        self._at[slot] = length
        return length

    def append(self, slot: Slot, data: bytes) -> None:
        if self.is_worn:
            self.is_worn = False
            raise MediumError("a word is worn")
        self.content[slot][self._at[slot] : self._at[slot] + len(data)] = data
        self._at[slot] += len(data)

    def read(self, slot: Slot, offset: int, length: int) -> bytes:
        if self._fails(_place(slot, offset), _place(slot, offset + length)):
            raise MediumError("a word cannot be corrected")
        return bytes(self.content[slot][offset : offset + length])

    def _fails(self, begin: int, end: int) -> bool:
        return any(self._unreadable[begin // WORD : -(-end // WORD)])


class Pair:
    """Both stores from an erased memory on; every call compares what they answer, and raises MismatchError. The supply
    goes in operation `cut_at`, from here on, if there is one; the seed is of what a cut leaves behind."""

    def __init__(self, library: Library, *, cut_at: int | None = None, seed: int = 0) -> None:
        self._ffi, self._c = library.ffi, library.c
        self._twin = self._ffi.new("uint64_t[]", self._c.twin_bytes() // 8 + 1)
        self._own, self._kept = self._c.twin_store(self._twin), self._c.twin_records(self._twin)
        self._c.twin_erased(self._twin, RULES)
        length = _place(Slot.B, SLOT_BYTES)
        self._memory = self._ffi.buffer(self._c.twin_memory(self._twin), length)
        self._unreadable = self._ffi.buffer(self._c.twin_unreadable(self._twin), length // WORD)
        self.flash = Flash(self._memory, self._unreadable)
        self._before, self.cut_at, self._seed = 0, cut_at, seed
        self._old: dict[RecordKind, bytes] = {}
        """Records before the call under way."""
        self._power_on()

    def boot(self, *, is_foreign: bool = False) -> None:
        """Off, on, and boot, perhaps from what this pair did not write."""
        self._power_on()
        if is_foreign:
            self._take_content(self.store.state)
        self._boot("boot")

    def call(self, name: str, *arguments: Any, is_abandoned: bool = False) -> tuple[int, Any]:
        """The same call of both, of which only the first piece is done if it is abandoned: how it ended, by the codes
        of C, and what it found."""
        python = self._python(name, arguments, is_abandoned)
        given = (*arguments, len(arguments[0])) if arguments and isinstance(arguments[0], bytes) else arguments
        code = getattr(self._c, f"sw_store_{name}")(self._own, *given) or DONE
        while code == MORE and not is_abandoned:
            code = self._c.sw_store_go_on(self._own)
        results = {"announce": self._c.twin_wanted, "finish": self._c.twin_verdict, "revert": self._c.twin_verdict}
        if code == DONE and name in results and not is_abandoned:
            self._compare(name, python, (code, results[name](self._twin)))
        else:
            self._compare(name, python, (DONE if code == MORE else code, None))
        return python

    def spoil(self, slot: Slot, at: int, *, readable: bool) -> None:
        """A byte of a slot is another one, or its word cannot be read any more."""
        place = _place(slot, at)
        if readable:
            self._memory[place] = bytes([self._memory[place][0] ^ 1])
            self.flash.content[slot][at] ^= 1
        else:
            self._unreadable[place // WORD] = b"\1"

    def wear(self, after: int, *, in_slot: bool = False) -> None:
        """Wear the word that is written after so many operations; one in a slot fails in Python's memory, too."""
        self._c.twin_wear(self._twin, self.operations - self._before + after)
        self.flash.is_worn = in_slot

    def fail(self, records: int) -> None:
        """The memory takes so many records more, and then none."""
        self._c.twin_fail(self._twin, records)
        self.flash.records_left = records

    def erases(self, looks: int, *, begins: bool = True, ends: bool = True) -> None:
        """From now on an erasure takes so many looks, or fails."""
        self._c.twin_erases(self._twin, looks, 2 if begins and not ends else int(not begins))
        self.flash.erases = begins and ends

    def limit(self, which: int) -> None:
        """What may be done to keep a record: an `sw_records_limit`."""
        self._c.twin_limit(self._twin, which)

    def go_on_in_c(self) -> None:
        """A piece of work that Python has thrown away."""
        self._c.sw_store_go_on(self._own)

    def care(self) -> int:
        """A piece of work for later records; operations of the memory in it."""
        before = self.operations
        self._c.sw_records_care(self._kept)
        self._compare("care", None, None)
        return self.operations - before

    @property
    def is_erasing(self) -> bool:
        return bool(self._c.sw_store_is_erasing(self._own))

    @property
    def has_room(self) -> bool:
        return bool(self._c.sw_store_has_room(self._own))

    def refuses(self, length: int) -> bool:
        """Whether the C store takes no record of so many bytes now; what it takes is taken by Python's as well."""
        if self._c.sw_store_keep_faults(self._own, bytes(length), length):
            return True
        self.flash.kept[RecordKind.FAULTS] = self.store.faults = bytes(length)
        return False

    def plant(self, kind: RecordKind, record: bytes, tails: bytes = bytes(2 * WORD)) -> None:
        """Boot from a record that no store writes; that of the state ends with the slots' last words, which C has."""
        raw = record + tails if kind == RecordKind.STATE else record
        assert self._c.sw_records_keep(self._kept, kind, raw, len(raw)) == 0
        self.flash.kept[kind] = record
        self.boot(is_foreign=True)

    def plant_log(self, sectors: bytes, unreadable: bytes, newest: dict[RecordKind, bytes]) -> None:
        """Boot with these sectors of records, of which these are the newest."""
        self._memory[: len(sectors)], self._unreadable[: len(unreadable)] = sectors, unreadable
        newest = {kind: raw[: -2 * WORD] if kind == RecordKind.STATE else raw for kind, raw in newest.items()}
        self.flash.kept = {kind: raw for kind, raw in newest.items() if raw}
        self.boot(is_foreign=True)

    def go_beyond(self) -> None:
        """What no Python caller can give is refused, and changes nothing."""
        c, own, much = self._c, self._own, MAX_RECORD + 1
        room = self._ffi.new("uint8_t[]", much)
        assert c.sw_store_go_on(own) == c.sw_store_failed_attempts(own, 2) == DONE
        assert c.sw_store_keep_failed_attempts(own, 2, 1) == c.sw_store_keep_faults(own, room, much) == 2
        assert c.sw_records_keep(self._kept, RecordKind.FAULTS, room, much) == 1
        for offset, length in ((much, 0), (0, much), (2**32 - 8, 16), (16, 2**32 - 8)):
            assert c.sw_records_read(self._kept, RecordKind.STATE, offset, room, length) == 1
        # A calibration counts as not kept from the moment when a word of it cannot be read.
        calibration = bytes(range(100))
        self.call("keep_calibration", calibration)
        word = bytes(self._memory).rindex(calibration[64:72]) // WORD
        for is_lost in (b"\1", b"\0"):
            self._unreadable[word] = is_lost
            assert c.sw_store_calibration(own, room, much) == (0 if is_lost > b"\0" else len(calibration))
        self._compare("beyond", None, None)

    def go_on(self, cut_at: int | None = None) -> None:
        """Power on after a cut and boot, and judge what is there; the supply may go again, so many operations later."""
        if not self._c.twin_is_off(self._twin):
            raise ValueError("the supply did not go")
        self.cut_at = None if cut_at is None else self.operations + cut_at
        states = [state.decode(raw) for raw in self._may_be(RecordKind.STATE) if raw]
        self._power_on(has_lost=True)
        self._boot("boot after a cut")
        if not states or any(one.active is None for one in states):
            return
        if self.store.running is None:
            raise MismatchError("bricked", f"no release runs: {self.store.last_boot}")
        confirmed = {one.slots[one.active].digest for one in states if one.active is not None}
        now = self.store.state
        if now.active is None or now.slots[now.active].digest not in confirmed:
            raise MismatchError("confirmed_lost", f"{now}")

    @property
    def operations(self) -> int:
        return self._before + int(self._c.twin_operations(self._twin))

    def _power_on(self, *, has_lost: bool = False) -> None:
        self._before = self.operations
        at = NEVER if self.cut_at is None or self.cut_at < self._before else self.cut_at - self._before
        self._seed += 1
        self._c.twin_power_on(self._twin, at, self._seed)
        if self._c.twin_is_off(self._twin):
            raise PowerCut
        if has_lost:
            self._take_over()
        self.store = Store(self.flash, **SETTINGS)

    def _boot(self, name: str) -> None:
        self.store.boot()
        self._c.sw_store_boot(self._own)
        self._compare(name, None, None)

    def _may_be(self, kind: RecordKind) -> list[bytes]:
        """Records of a kind that may be found after a cut in the call under way."""
        return [self._old.get(kind, b""), *(raw for one, raw in self.flash.passed if one == kind)]

    def _take_over(self) -> None:
        """Hold what is found against what may be, and give it to the Python store."""
        self.flash.kept = {}
        for kind in RecordKind:
            raw = self._record(kind)
            if raw not in self._may_be(kind):
                raise MismatchError("mismatches", f"{kind.name} after a cut is none that may be: {raw.hex()}")
            if raw:
                self.flash.kept[kind] = raw
        kept = self.flash.kept.get(RecordKind.STATE)
        self._take_content(state.StoreState() if kept is None else state.decode(kept))

    def _take_content(self, found: state.StoreState) -> None:
        for slot, content in self.flash.content.items():
            standing = found.slots[slot]
            content[:] = self._memory[_place(slot, 0) : _place(slot, SLOT_BYTES)]
            behind = standing.received % WORD if standing.received < standing.length else 0
            tail = self._ffi.buffer(self._c.twin_tail(self._twin, slot), WORD)
            content[standing.received - behind : standing.received] = tail[:behind]

    def _python(self, name: str, arguments: tuple[Any, ...], is_abandoned: bool) -> tuple[int, Any]:
        if name == "keep_calibration":
            arguments = (arguments[0] or None,)
        try:
            work = getattr(self.store, name)(*arguments)
            if is_abandoned:
                next(work, None)
            return DONE, at_once(work) if isinstance(work, Generator) and not is_abandoned else None
        except (OutOfOrderError, KeyFileError, MediumError, ConfigError) as error:
            return next(code for kind, code in _CODES.items() if isinstance(error, kind)), None

    def _record(self, kind: RecordKind) -> bytes:
        """A record; that of the state without the bytes behind each slot's last whole word, which Python has not."""
        read, length = self._c.sw_records_read, self._c.sw_records_length(self._kept, kind)
        raw = self._text(lambda to: 0 if read(self._kept, kind, 0, to, length) else length)
        return raw[: -2 * WORD] if kind == RecordKind.STATE else raw

    def _text(self, function: Callable[..., int], *arguments: Any) -> bytes:
        buffer = self._ffi.new("uint8_t[]", 8192)
        return bytes(self._ffi.buffer(buffer, function(*arguments, buffer)))

    def _compare(self, name: str, python: object, found: object) -> None:
        """Both answers, and all that can be seen of both stores; raises PowerCut if the supply went."""
        if self._c.twin_is_off(self._twin):
            raise PowerCut
        store, c, own = self.store, self._c, self._own
        running = None if store.running is None else store.state.slots[store.running]
        calibration = None if running is None else store.calibration(running.digest)
        image = c.sw_store_image(own)
        attempts = [(store.state.failed_attempts[level], c.sw_store_failed_attempts(own, level)) for level in Level]
        seen = {
            "answer": (python, found),
            "report": (report.encode(store), self._text(c.sw_store_report, own)),
            "received": (0xFFFFFFFF if store.received is None else store.received, c.sw_store_received(own)),
            **{kind.name: (self.flash.kept.get(kind, b""), self._record(kind)) for kind in RecordKind},
            "calibration": (calibration or b"", self._text(lambda to: c.sw_store_calibration(own, to, 1024))),
            **{f"attempts {level}": both for level, both in zip(Level, attempts, strict=True)},
            "calibration's length": (len(calibration or b""), c.sw_store_calibration(own, self._ffi.NULL, 0)),
            "faults without room": (0, c.sw_store_faults(own, self._ffi.NULL, 0)),
            "faults": (store.faults, self._text(lambda to: c.sw_store_faults(own, to, 8192))),
            "words written twice": (0, c.twin_twice(self._twin)),
            "whether an image runs": (running is not None, image != self._ffi.NULL),
        }
        different = [f"{what}: {one!r} in Python, {two!r} in C" for what, (one, two) in seen.items() if one != two]
        if different:
            raise MismatchError("mismatches", f"{name}: {'; '.join(different)}")
        if running is not None and bytes(self._ffi.buffer(image, running.length)) not in RUNNABLE:
            raise MismatchError("unsigned", f"{name}: {running.name} runs")
        self._old, self.flash.passed = dict(self.flash.kept), []
