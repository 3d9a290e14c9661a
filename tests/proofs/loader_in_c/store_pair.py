"""The store in C and the Python store, which is its specification, side by side: the same calls, the same answers.

The supply of the C store may go in any operation of its flash memory. What is then found must be a state that the
Python store passes through in the call that was cut, and the Python store goes on from there.
"""

from collections.abc import Callable, Generator
from functools import partial
from typing import Any, Final

from can_bridge.flashing import checking, report, state
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Kind, Slot, Work, at_once
from can_bridge.flashing.medium import MediumError
from can_bridge.flashing.store import OutOfOrderError, Store
from can_bridge.flashing.verdicts import Verdict
from contract.errors import ConfigError, KeyFileError
from contract.release.signing import public_key
from tests.can_bridge.flashing.medium import PowerCut
from tests.can_bridge.flashing.releases import ROOT
from tests.proofs.loader_in_c.store_library import (
    GOOD,
    HARDWARE,
    LAYOUT,
    LONG,
    NEVER,
    ONE,
    SECTOR,
    SLOT_BYTES,
    WORD,
    WRONG,
    Library,
    rules,
)

DONE, MORE, OUT_OF_RANGE, OUT_OF_ORDER, BAD_KEYS, BAD_MEMORY = range(6)
_RECORDS: Final = 2 * SECTOR
_TAILS: Final = 2 * WORD
_RUNNABLE: Final = frozenset({*GOOD.values(), LONG, WRONG["any"], WRONG["full"]})


class MismatchError(AssertionError):
    """Both stores differ, or a promise is broken; `kind` is "mismatches", "bricked", "confirmed_lost" or "unsigned"."""

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(f"{kind}: {text}")
        self.kind = kind


class Flash:
    """The `Backing` of the Python store, as a flash memory behaves: an image goes on where its words are blank."""

    capacity = SLOT_BYTES

    def __init__(self, is_dirty: Callable[[Slot, int, int], bool]) -> None:
        self.kept: dict[Kind, bytes] = {}
        self.passed: list[tuple[Kind, bytes]] = []
        """Every record that was kept, in order."""
        self.content = {slot: bytearray(b"\xff" * SLOT_BYTES) for slot in Slot}
        self.unreadable: set[tuple[Slot, int]] = set()
        self.is_worn = False
        self._at = dict.fromkeys(Slot, 0)
        self._is_dirty = is_dirty

    def records(self) -> dict[Kind, bytes]:
        return dict(self.kept)

    def keep(self, kind: Kind, record: bytes) -> None:
        self.passed.append((kind, record))
        self.kept[kind] = record

    def clear(self, slot: Slot, behind: int = 0) -> Work[None]:
        for at in range(behind, SLOT_BYTES, SECTOR):
            yield
            self.content[slot][at : at + SECTOR] = b"\xff" * SECTOR
            self.unreadable -= {(slot, word) for word in range(at // WORD, (at + SECTOR) // WORD)}
        self._at[slot] = behind

    def begin_again(self, slot: Slot, length: int) -> int:
        whole = state.decode(self.kept[Kind.STATE]).slots[slot].length
        if length < whole and self._is_dirty(slot, length // WORD * WORD, whole):
            length = length // SECTOR * SECTOR
            if not length:
                raise MediumError("the first sector has words too many", 0)
        self._at[slot] = length
        return length

    def append(self, slot: Slot, data: bytes) -> None:
        if self.is_worn:
            self.is_worn = False
            raise MediumError("a word is worn", self._at[slot])
        self.content[slot][self._at[slot] : self._at[slot] + len(data)] = data
        self._at[slot] += len(data)

    def read(self, slot: Slot, offset: int, length: int) -> bytes:
        if any((slot, word) in self.unreadable for word in range(offset // WORD, -(-(offset + length) // WORD))):
            raise MediumError("a word cannot be corrected", offset)
        return bytes(self.content[slot][offset : offset + length])


class Pair:
    """Both stores from an erased memory on; every call compares what they answer, and raises MismatchError.

    Args:
        cut_at: operation of the flash memory, from here on, in which the supply goes; None: in none.
        seed: of what a cut leaves behind.
    """

    def __init__(self, library: Library, *, cut_at: int | None = None, seed: int = 0) -> None:
        self._ffi, self._c = library.ffi, library.c
        self._twin = self._ffi.new("uint64_t[]", self._c.twin_bytes() // 8 + 1)
        self._buffer = self._ffi.new("uint8_t[]", 8192)
        self._c.twin_erased(self._twin, rules(ONE))
        self._before, self.cut_at, self._seed = 0, cut_at, seed
        self.flash = Flash(self._is_dirty)
        self._old: dict[Kind, bytes] = {}
        """Records before the call under way."""
        self._power_on()
        self._made()

    # What both do.

    def boot(self) -> None:
        """Off, on, and boot."""
        self._made()
        self.store.boot()
        self._power_on()
        self._c.sw_store_boot(self._own)
        self._compare("boot", None, None)

    def announce(self, whole: bytes, sha256: bytes, *, abandoned: bool = False) -> int | None:
        """The offset that is wanted; None where the image is not taken."""
        work = self.store.announce(len(whole), sha256)
        python = self._python(lambda: next(work, None) if abandoned else at_once(work))
        found = self._c.sw_store_announce(self._own, len(whole), sha256)
        found = min(found, DONE) if abandoned and found == MORE else self._all(found)
        if abandoned:
            python = python[0], None
        self._compare(
            "announce", python, (found, self._c.twin_wanted(self._twin) if not (found or abandoned) else None)
        )
        return python[1]

    def append(self, data: bytes) -> bool:
        python = self._python(lambda: self.store.append(data))
        self._compare("append", python, (self._c.sw_store_append(self._own, data, len(data)), None))
        return python[0] == DONE

    def finish(self) -> Verdict | None:
        return self._judged("finish", self.store.finish(), self._c.sw_store_finish)

    def revert(self) -> Verdict | None:
        return self._judged("revert", self.store.revert(), self._c.sw_store_revert)

    def activate(self) -> bool:
        return self._plain("activate", self.store.activate)

    def confirm(self) -> bool:
        return self._plain("confirm", self.store.confirm)

    def drop(self) -> bool:
        return self._plain("drop", self.store.drop)

    def take_keys(self, raw: bytes) -> bool:
        return self._plain("take_keys", self.store.take_keys, raw, length=True)

    def keep_calibration(self, blob: bytes) -> bool:
        return self._plain("keep_calibration", lambda raw: self.store.keep_calibration(raw or None), blob, length=True)

    def keep_faults(self, record: bytes) -> bool:
        return self._plain("keep_faults", self.store.records.keep_faults, record, length=True)

    def keep_failed_attempts(self, level: Level, count: int) -> bool:
        return self._plain("keep_failed_attempts", self.store.records.keep_failed_attempts, level, count)

    def spoil(self, slot: Slot, at: int, *, readable: bool) -> None:
        """A byte of a slot is another one, or its word cannot be read any more."""
        begin = _RECORDS + slot * SLOT_BYTES
        if readable:
            self._ffi.cast("uint8_t *", self._c.twin_memory(self._twin))[begin + at] ^= 1
            self.flash.content[slot][at] ^= 1
        else:
            self._ffi.cast("uint8_t *", self._c.twin_unreadable(self._twin))[(begin + at) // WORD] = 1
            self.flash.unreadable.add((slot, at // WORD))

    def wear(self, after: int, *, in_slot: bool = False) -> None:
        """Wear the word that is written after so many operations; one in a slot fails in Python's memory, too."""
        self._c.twin_wear(self._twin, self.operations - self._before + after)
        self.flash.is_worn = in_slot

    # After a cut.

    def go_on(self, cut_at: int | None = None) -> None:
        """Power on after a cut and boot, and judge what is there; the supply may go again, so many operations later."""
        if not self._c.twin_is_off(self._twin):
            raise ValueError("the supply did not go")
        self.cut_at = None if cut_at is None else self.operations + cut_at
        active = self._active()
        self._power_on()
        self._take_over()
        self._made()
        self.store.boot()
        self._c.sw_store_boot(self._own)
        self._compare("boot after a cut", None, None)
        if active is not None and self.store.running is None:
            raise MismatchError("bricked", f"no release runs: {self.store.last_boot}")
        now = self.store.state
        if active is not None and (now.active is None or now.slots[now.active].digest not in active):
            raise MismatchError("confirmed_lost", f"{now}")

    @property
    def operations(self) -> int:
        """Of the flash memory so far."""
        return self._before + int(self._c.twin_operations(self._twin))

    @property
    def _own(self) -> Any:
        return self._c.twin_store(self._twin)

    def _made(self) -> None:
        self.store = Store(
            self.flash,
            root=public_key(ROOT),
            hardware=HARDWARE,
            fits=checking.fits_as(ONE),
            check=partial(checking.judge_image, layout=LAYOUT),
        )

    def _active(self) -> set[str] | None:
        """Digests of the release that was confirmed before the call that was cut, and of those confirmed in it."""
        passed = [state.decode(record) for record in self._states() if record]
        if not passed or any(one.active is None for one in passed):
            return None
        return {one.slots[one.active].digest for one in passed if one.active is not None}

    def _states(self) -> list[bytes]:
        """Records of the state that may be found after a cut in the call under way."""
        return [self._old.get(Kind.STATE, b""), *(raw for kind, raw in self.flash.passed if kind == Kind.STATE)]

    def _take_over(self) -> None:
        """Hold what is found against what may be, and give it to the Python store."""
        for kind in Kind:
            raw = self._record(kind)
            if kind == Kind.STATE:
                raw = raw[:-_TAILS]
            may_be = [self._old.get(kind, b""), *(record for one, record in self.flash.passed if one == kind)]
            if raw not in may_be:
                raise MismatchError("mismatches", f"{kind.name} after a cut: {raw.hex()}, of {len(may_be)} that may be")
            self.flash.kept.pop(kind, None)
            if raw:
                self.flash.kept[kind] = raw
        received = self.flash.kept.get(Kind.STATE)
        for slot in Slot:
            begin = _RECORDS + slot * SLOT_BYTES
            memory = self._ffi.buffer(self._c.twin_memory(self._twin) + begin, SLOT_BYTES)
            self.flash.content[slot][:] = bytes(memory)
            if received is not None and (at := state.decode(received).slots[slot].received % WORD):
                whole = state.decode(received).slots[slot]
                if whole.received < whole.length:
                    tail = bytes(self._ffi.buffer(self._c.twin_tail(self._twin, slot), WORD))
                    self.flash.content[slot][whole.received - at : whole.received] = tail[:at]
            flags = self._ffi.buffer(self._c.twin_unreadable(self._twin) + begin // WORD, SLOT_BYTES // WORD)
            self.flash.unreadable -= {one for one in self.flash.unreadable if one[0] == slot}
            self.flash.unreadable |= {(slot, word) for word, flag in enumerate(bytes(flags)) if flag}

    def _is_dirty(self, slot: Slot, begin: int, end: int) -> bool:
        """Whether a word that is to be written is not blank, by the memory itself."""
        at = _RECORDS + slot * SLOT_BYTES
        end = -(-end // WORD) * WORD
        words = bytes(self._ffi.buffer(self._c.twin_memory(self._twin) + at + begin, end - begin))
        flags = bytes(
            self._ffi.buffer(self._c.twin_unreadable(self._twin) + (at + begin) // WORD, (end - begin) // WORD)
        )
        return words != b"\xff" * len(words) or any(flags)

    def _power_on(self) -> None:
        self._before = self.operations
        at = NEVER if self.cut_at is None or self.cut_at < self._before else self.cut_at - self._before
        self._seed += 1
        self._c.twin_power_on(self._twin, at, self._seed)
        if self._c.twin_is_off(self._twin):
            raise PowerCut

    def _python(self, call: Callable[[], Any]) -> tuple[int, Any]:
        try:
            return DONE, call()
        except OutOfOrderError:
            return OUT_OF_ORDER, None
        except KeyFileError:
            return BAD_KEYS, None
        except MediumError:
            return BAD_MEMORY, None
        except ConfigError:
            return OUT_OF_RANGE, None

    def _all(self, found: int) -> int:
        while found == MORE:
            found = self._c.sw_store_go_on(self._own)
        return found

    def _judged(self, name: str, work: Generator[None, None, Verdict], call: Callable[[Any], int]) -> Verdict | None:
        python = self._python(lambda: at_once(work))
        found = self._all(call(self._own))
        self._compare(name, python, (found, self._c.twin_verdict(self._twin) if found == DONE else None))
        return python[1]

    def _plain(self, name: str, call: Callable[..., None], *arguments: Any, length: bool = False) -> bool:
        python = self._python(lambda: call(*arguments))
        more = (len(arguments[0]),) if length else ()
        found = getattr(self._c, f"sw_store_{name}")(self._own, *arguments, *more)
        self._compare(name, python, (found or DONE, None))
        return python[0] == DONE

    def _record(self, kind: Kind) -> bytes:
        return self._text(lambda data: self._c.twin_record(self._twin, kind, data))

    def _text(self, call: Callable[[Any], int]) -> bytes:
        length = call(self._buffer)
        return bytes(self._ffi.buffer(self._buffer, length))

    def _compare(self, name: str, python: object, found: object) -> None:
        """Both answers, and all that can be seen of both stores; raises PowerCut if the supply went."""
        if self._c.twin_is_off(self._twin):
            raise PowerCut
        store = self.store
        received = 0xFFFFFFFF if store.received is None else store.received
        running = None if store.running is None else store.state.slots[store.running]
        seen = {
            "answer": (python, found),
            "report": (
                report.encode(report.report_of(store)),
                self._text(lambda to: self._c.sw_store_report(self._own, to)),
            ),
            "received": (received, self._c.sw_store_received(self._own)),
            "state": (self.flash.kept.get(Kind.STATE, b""), self._record(Kind.STATE)[:-_TAILS]),
            **{kind.name: (self.flash.kept.get(kind, b""), self._record(kind)) for kind in Kind if kind != Kind.STATE},
            "calibration": (
                b"" if running is None else store.records.calibration(running.digest) or b"",
                self._text(lambda to: self._c.sw_store_calibration(self._own, to)),
            ),
            "attempts": (
                [store.state.failed_attempts[level] for level in Level],
                [self._c.sw_store_failed_attempts(self._own, level) for level in Level],
            ),
            "faults": (store.records.faults, self._text(lambda to: self._c.sw_store_faults(self._own, to, 8192))),
            "words written twice": (0, self._c.twin_twice(self._twin)),
        }
        different = [
            f"{what}: {one!r} in Python, {other!r} in C" for what, (one, other) in seen.items() if one != other
        ]
        if different:
            raise MismatchError("mismatches", f"{name}: {'; '.join(different)}")
        image = self._c.sw_store_image(self._own)
        if (image == self._ffi.NULL) != (running is None):
            raise MismatchError("mismatches", f"{name}: an image runs in one of both")
        if running is not None and bytes(self._ffi.buffer(image, running.length)) not in _RUNNABLE:
            raise MismatchError("unsigned", f"{name}: {running.name} runs")
        self._old, self.flash.passed = dict(self.flash.kept), []
