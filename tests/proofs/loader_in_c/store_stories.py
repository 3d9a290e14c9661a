"""What happens to both stores: random calls, and the ways in which an ECU is used, cut anywhere."""

import hashlib
from collections import Counter
from collections.abc import Callable
from random import Random
from typing import Final

from can_bridge.flashing.backing import RecordKind, Slot
from can_bridge.flashing.state import Level, SlotPhase
from can_bridge.flashing.verdicts import Verdict
from tests.can_bridge.flashing.releases import RELEASE, ROOT, SECOND, STRANGER, keys
from tests.proofs.loader_in_c.store_library import GOOD, LONG, NEVER, SLOT_BYTES, WRONG, Library
from tests.proofs.loader_in_c.store_pair import DONE, MismatchError, Pair, PowerCut

LISTS: Final = (
    keys(1), keys(2, RELEASE, SECOND), keys(3, SECOND, revoked=(RELEASE,)),
    keys(4, RELEASE, revoked=(STRANGER, SECOND)), keys(5, RELEASE, SECOND), keys(6, RELEASE)[:-1], b"", b"{}",
    bytes(2000), keys(7, RELEASE)[:50] + b"\1" + keys(7, RELEASE)[51:],
    *(
        text + ROOT.sign(text)
        for listed in (keys(8, RELEASE, SECOND, revoked=(STRANGER,))[:-64],)
        for at, value in (
            (0, b"X"), (8, bytes(4)), (12, b"\0"), (12, b"\x11"), (12, b"\1"), (13, b"\x11"), (13, b"\2"), (14, b"\1"),
            (15, b"\1"), (16, b"\1"), (48, listed[80:112]), (48, b"\xff" * 32), (80, bytes(32)), (112, listed[48:80]),
            (48, bytes(32)), (13, b"\0"), (48, b"\xec" + b"\xff" * 30 + b"\x7f"), (48, b"\1" + bytes(31)),
            (12, b"\1\2" + listed[14:80] + listed[112:] + listed[80:112]),
        )
        for text in (listed[:at] + value + listed[at + len(value) :],)
    ),
)  # fmt: skip
MOVE, APPEND = 1, 2  # `sw_records_limit`
IMAGES: Final = (*GOOD.values(), *WRONG.values(), LONG)


def transfer(pair: Pair, whole: bytes, block: int, until: int | None = None) -> None:
    """Announce an image and send what is wanted of it, up to a block's end."""
    code, wanted = pair.call("announce", len(whole), hashlib.sha256(whole).digest())
    if code == DONE:
        for at in range(wanted, len(whole) if until is None else until, block):
            pair.call("append", whole[at : at + block])


def flash(pair: Pair, whole: bytes, block: int = 500) -> None:
    transfer(pair, whole, block)
    if pair.call("finish") == (DONE, Verdict.GOOD):
        pair.call("activate")
        pair.boot()
        pair.call("confirm")


def put_on_trial(pair: Pair, whole: bytes) -> None:
    transfer(pair, whole, 999)
    pair.call("finish")
    pair.call("activate")


def provision(pair: Pair) -> None:
    pair.call("take_keys", LISTS[1])
    flash(pair, GOOD["one"])
    pair.boot()


def any_calls(pair: Pair, seed: str, calls: int) -> None:
    """Calls at random, most of them such that something comes of it."""
    random, sent = Random(seed), b""
    if random.random() < 0.7:
        provision(pair)
    for _ in range(calls):
        match random.choice(_CALLS):
            case "transfer":
                sent = random.choice(IMAGES)
                until = None if random.random() < 0.8 else random.randrange(len(sent) + 1)
                transfer(pair, sent, random.choice((32, 100, 500, 4096, 20_000)), until)
                if random.random() < 0.5:
                    pair.call("finish")
            case "append":
                at = pair.store.received or 0
                sent_on = sent[at : at + random.choice((0, 1, 31, 300))]
                pair.call("append", sent_on + bytes(random.choice((0, 0, 0, 5000))))
            case "announce":
                length = random.choice((0, 1, 700, SLOT_BYTES, SLOT_BYTES + 1))
                sha256 = random.choice((bytes(32), hashlib.sha256(sent).digest()))
                pair.call("announce", length, sha256, is_abandoned=random.random() < 0.5)
            case "update":
                flash(pair, random.choice((*GOOD.values(), LONG)), random.choice((64, 777)))
            case "trial":
                put_on_trial(pair, random.choice(list(GOOD.values())))
                if (slot := pair.store.state.on_trial) is not None and slot != pair.store.running:
                    pair.spoil(slot, 64, readable=random.random() < 0.5)
                pair.boot()
            case "keys":
                is_listed = random.random() < 0.8
                newest = random.choice(LISTS) if is_listed else keys(random.randrange(1, 99), RELEASE, SECOND)
                pair.call("take_keys", newest)
            case "calibration":
                pair.call("keep_calibration", random.randbytes(random.choice((0, 0, 1, 24, 100, 1024, 1025))))
            case "attempts":
                pair.call("keep_failed_attempts", random.choice(list(Level)), random.choice((0, 1, 3, 255, 300)))
            case "faults":
                pair.call("keep_faults", random.randbytes(random.choice((1, 23, 24, 25, 54, 55, 56, 300))))
            case "spoil":
                slot = random.choice(list(Slot))
                if (length := pair.store.state.slots[slot].received) > 100:
                    # Not what goes on in a transfer: bytes behind the last whole word are not in the memory.
                    pair.spoil(slot, random.randrange(length // 32 * 32), readable=random.random() < 0.7)
                    if slot == pair.store.running:
                        pair.boot()
            case "boot":
                pair.boot()
            case name:
                pair.call(name)


_CALLS: Final = (
    "transfer", "transfer", "append", "announce", "update", "finish", "finish", "activate", "activate", "confirm",
    "revert", "drop", "boot", "boot", "keys", "calibration", "attempts", "faults", "spoil", "trial",
)  # fmt: skip


def updated(pair: Pair) -> None:
    """A new release with two slots' worth of blocks, a calibration, and back."""
    flash(pair, GOOD["three"])
    pair.call("keep_calibration", bytes(range(100)))
    pair.call("revert")
    pair.call("announce", len(WRONG["any"]), bytes(32))
    pair.boot()
    pair.call("keep_calibration", bytes(30))


def given_up(pair: Pair) -> None:
    """A release is put on trial and never confirmed."""
    transfer(pair, GOOD["two"], 1000)
    for name in ("finish", "activate", "activate"):
        pair.call(name)
    for _ in range(4):
        pair.boot()


def refused(pair: Pair) -> None:
    """A release by a stranger, then one that is left half way, then another key list."""
    for name in ("signature", "stranger"):
        transfer(pair, WRONG[name], 700)
        pair.call("finish")
    pair.call("activate")
    transfer(pair, LONG, 1700, 9_000)
    pair.call("drop")
    transfer(pair, LONG, 1700)
    pair.call("take_keys", LISTS[4])
    pair.call("keep_failed_attempts", Level.PROGRAMMING, 2)
    for length in range(8, 32):
        pair.call("keep_faults", bytes(length))


STORIES: Final[tuple[Callable[[Pair], None], ...]] = (updated, given_up, refused)
"""The ways in which an ECU is used."""


def beyond(pair: Pair) -> None:
    """Arguments that no Python caller can give; then key lists that count as never kept."""
    provision(pair)
    pair.go_beyond()
    for listed in (LISTS[5], LISTS[8]):
        pair.plant(RecordKind.KEYS, listed)
        assert pair.store.running is None
    assert pair.call("take_keys", LISTS[1])[0] == DONE
    flash(pair, GOOD["two"])
    assert pair.store.running == Slot.B


def tried(pair: Pair) -> None:
    """On trial: before any is confirmed, twice, while the memory fails, by a key that goes; then back and forth."""
    pair.call("take_keys", LISTS[1])
    for whole in (WRONG["any"], GOOD["one"]):
        put_on_trial(pair, whole)
        pair.boot()
    assert pair.call("confirm")[0] == DONE
    for _ in range(2):
        put_on_trial(pair, GOOD["three"])
        pair.boot()
        pair.call("activate")
    pair.fail(0)
    pair.call("revert")
    pair.fail(NEVER)
    assert pair.call("take_keys", LISTS[3])[0] == DONE
    for name in ("confirm", "revert", "confirm"):
        pair.call(name)
    put_on_trial(pair, GOOD["two"])
    pair.spoil(Slot.A, 64, readable=True)
    for records in (1, NEVER):
        pair.fail(records)
        pair.boot()
    for _ in range(2):
        flash(pair, WRONG["any"])
        before = pair.store.running
        pair.spoil(Slot.A, 64, readable=True)
        pair.boot()
        assert (before, pair.store.running) == (Slot.A, Slot.B)
    flash(pair, WRONG["any"])
    for _ in range(2):
        pair.call("revert")


def cared(pair: Pair) -> None:
    """With the jets on a full sector is not left; then it is, and is blanked, unless the memory fails."""
    for _ in range(3):
        assert pair.care() == 0
    provision(pair)
    pair.erases(2)
    pair.call("announce", 700, bytes(32), is_abandoned=True)
    pair.go_on_in_c()
    pair.call("drop")
    for begins, ends in ((True, True), (False, True), (True, False)):
        flash(pair, GOOD["two"])
        assert [pair.care() for _ in range(9)][-4:] == [0] * 4
        pair.limit(APPEND)
        while pair.has_room:
            pair.call("keep_failed_attempts", Level.PROGRAMMING, pair.operations % 200 + 1)
        assert pair.refuses(8000)
        pair.limit(MOVE)
        assert pair.has_room
        pair.erases(2, begins=begins, ends=ends)
        # Moved; then the erasure begins, and is looked after, or is not tried again.
        assert pair.care() > 10
        found = [(pair.care(), pair.refuses(1)) for _ in range(5)]
        erasing = begins * (3 if ends else 1)
        assert [is_erasing for _, is_erasing in found] == [True] * erasing + [False] * (5 - erasing)
        if not (begins and ends):
            pair.call("announce", 700, bytes(32))
        pair.erases(2)
        pair.boot()
    # What is kept is most of a sector; then it cannot be moved.
    for length in (4000, 1):
        pair.call("keep_faults", bytes(length))
        for count in range(30):
            pair.call("keep_failed_attempts", Level.PROGRAMMING, count + length)
            pair.fail(NEVER if length > 1 else 0)
            pair.care()
            pair.fail(NEVER)
            while pair.is_erasing:
                pair.care()
    pair.limit(MOVE)
    while not pair.refuses(300):
        pass
    # Before the control begins an erasure is waited for, and may fail.
    pair.boot()
    pair.erases(2, begins=False)
    assert pair.refuses(8000)
    while not pair.refuses(300):
        pass
    pair.erases(2)
    assert not pair.refuses(300)


RARE: Final = (beyond, tried, cared)  # what stories, and random calls, rarely come to


def recovered(pair: Pair) -> None:
    """Whatever was cut: release "two" can be flashed, and runs confirmed after the next boot."""
    if pair.store.state.on_trial is not None:
        pair.call("revert")
    pair.boot()
    if not _runs(pair):
        flash(pair, GOOD["two"], 900)
        pair.boot()
    if not _runs(pair):
        raise MismatchError("bricked", f"release two was not flashed: {pair.store.state}")


def _runs(pair: Pair) -> bool:
    running = pair.store.running
    slot = None if running is None else pair.store.state.slots[running]
    return slot is not None and (slot.name, slot.phase) == ("two", SlotPhase.CONFIRMED)


class Cuts:
    """All cuts of all stories up to one with a finding: in every operation, or in each one of so many, each with so
    many second cuts in its recovery. What came of them: counts, and findings in words."""

    def __init__(self, library: Library, seed: int, *, every: int = 1, seconds: int = 1) -> None:
        kinds = ("cuts_depth_1", "cuts_depth_2", "bricked", "confirmed_lost", "unsigned", "mismatches")
        self.counts, self.findings, self._library = Counter(dict.fromkeys(kinds, 0)), list[str](), library
        for number, story in enumerate(STORIES):
            whole = Pair(library)
            provision(whole)
            begin = whole.operations
            story(whole)
            for at in range(begin + seed % every, whole.operations, every):
                random = Random(f"{seed}.{number}.{at}")
                for second in (None, *(random.randrange(300) for _ in range(seconds))):
                    if not self.findings:
                        self._cut(story, at, second, seed + at)

    def _cut(self, story: Callable[[Pair], None], at: int, second: int | None, seed: int) -> None:
        self.counts["cuts_depth_1"] += second is None
        try:
            pair = Pair(self._library, cut_at=at, seed=1000 * seed + (second or 0))
            try:
                provision(pair)
                story(pair)
                raise ValueError(f"operation {at} of {story.__name__} was not reached")
            except PowerCut:
                pass
            while True:
                try:
                    pair.go_on(second)
                    recovered(pair)
                    break
                except PowerCut:
                    self.counts["cuts_depth_2"] += 1
                    second = None
        except MismatchError as error:
            self.counts[error.kind] += 1
            self.findings.append(f"{story.__name__}, cut at {at}, then {second}: {error}")
