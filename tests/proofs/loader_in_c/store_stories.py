"""What happens to both stores: random calls, and the ways in which an ECU is used, cut anywhere."""

import hashlib
from collections import Counter
from collections.abc import Callable
from random import Random
from typing import Final

from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Slot
from can_bridge.flashing.state import Phase
from can_bridge.flashing.verdicts import Verdict
from tests.can_bridge.flashing.medium import PowerCut
from tests.can_bridge.flashing.releases import RELEASE, ROOT, SECOND, STRANGER, keys
from tests.proofs.loader_in_c.store_library import GOOD, LONG, SLOT_BYTES, WRONG, Library
from tests.proofs.loader_in_c.store_pair import MismatchError, Pair

LISTS: Final = (
    keys(1), keys(2, RELEASE, SECOND), keys(3, SECOND, revoked=(RELEASE,)),
    keys(4, RELEASE, revoked=(STRANGER, SECOND)), keys(5, RELEASE, SECOND), keys(6, RELEASE)[:-1], b"", b"{}",
    keys(7, RELEASE)[:50] + b"\1" + keys(7, RELEASE)[51:],
    *(
        text + ROOT.sign(text)
        for listed in (keys(8, RELEASE, SECOND, revoked=(STRANGER,))[:-64],)
        for at, value in (
            (0, b"X"), (8, bytes(4)), (12, b"\0"), (12, b"\x11"), (12, b"\1"), (13, b"\x11"), (13, b"\2"), (14, b"\1"),
            (15, b"\1"), (16, b"\1"), (48, listed[80:112]), (48, b"\xff" * 32), (80, bytes(32)), (112, listed[48:80]),
            (48, bytes(32)), (13, b"\0"), (48, b"\xec" + b"\xff" * 30 + b"\x7f"), (48, b"\1" + bytes(31)),
        )
        for text in (listed[:at] + value + listed[at + len(value) :],)
    ),
)  # fmt: skip
IMAGES: Final = (*GOOD.values(), *WRONG.values(), LONG)


def transfer(pair: Pair, whole: bytes, block: int, until: int | None = None) -> None:
    """Announce an image and send what is wanted of it, up to a block's end."""
    wanted = pair.announce(whole, hashlib.sha256(whole).digest())
    if wanted is not None:
        for at in range(wanted, len(whole) if until is None else until, block):
            pair.append(whole[at : at + block])


def flash(pair: Pair, whole: bytes, block: int = 500) -> None:
    """Until the image is confirmed."""
    transfer(pair, whole, block)
    if pair.finish() == Verdict.GOOD:
        pair.activate()
        pair.boot()
        pair.confirm()


def provision(pair: Pair) -> None:
    pair.take_keys(LISTS[1])
    flash(pair, GOOD["one"])
    pair.boot()


def any_calls(pair: Pair, seed: str, calls: int) -> Counter[str]:
    """Calls at random, most of them such that something comes of it; how many of each."""
    random, counts, sent = Random(seed), Counter[str](), b""
    if random.random() < 0.7:
        provision(pair)
    for _ in range(calls):
        name = random.choice(_CALLS)
        counts[name] += 1
        if name == "transfer":
            sent = random.choice(IMAGES)
            until = None if random.random() < 0.8 else random.randrange(len(sent) + 1)
            transfer(pair, sent, random.choice((32, 100, 500, 4096, 20_000)), until)
            if random.random() < 0.5:
                pair.finish()
        elif name == "append":
            at = pair.store.received or 0
            pair.append(sent[at : at + random.choice((0, 1, 31, 300))] + bytes(random.choice((0, 0, 0, 5000))))
        elif name == "announce":
            length = random.choice((0, 1, 700, SLOT_BYTES, SLOT_BYTES + 1))
            pair.announce(
                bytes(length),
                random.choice((bytes(32), hashlib.sha256(sent).digest())),
                abandoned=random.random() < 0.5,
            )
        elif name == "update":
            flash(pair, random.choice((*GOOD.values(), LONG)), random.choice((64, 777)))
        elif name == "trial":
            transfer(pair, random.choice(list(GOOD.values())), 999)
            pair.finish()
            pair.activate()
            if (slot := pair.store.state.on_trial) is not None and slot != pair.store.running:
                pair.spoil(slot, 64, readable=random.random() < 0.5)
            pair.boot()
        elif name == "keys":
            pair.take_keys(
                random.choice(LISTS) if random.random() < 0.8 else keys(random.randrange(1, 99), RELEASE, SECOND)
            )
        elif name == "calibration":
            pair.keep_calibration(random.randbytes(random.choice((0, 0, 1, 24, 100, 1024, 1025))))
        elif name == "attempts":
            pair.keep_failed_attempts(random.choice(list(Level)), random.choice((0, 1, 3, 255, 300)))
        elif name == "faults":
            pair.keep_faults(random.randbytes(random.choice((1, 23, 24, 25, 54, 55, 56, 300))))
        elif name == "spoil":
            slot = random.choice(list(Slot))
            if (length := pair.store.state.slots[slot].received) > 100:
                # Not what goes on in a transfer: bytes behind the last whole word are not in the memory.
                pair.spoil(slot, random.randrange(length // 32 * 32), readable=random.random() < 0.7)
                if slot == pair.store.running:
                    pair.boot()
        else:
            getattr(pair, name)()
    return counts


_CALLS: Final = (
    "transfer", "transfer", "append", "announce", "update", "finish", "finish", "activate", "activate", "confirm",
    "revert", "drop", "boot", "boot", "keys", "calibration", "attempts", "faults", "spoil", "trial",
)  # fmt: skip


# The ways in which an ECU is used.


def updated(pair: Pair) -> None:
    """A new release with two slots' worth of blocks, a calibration, and back."""
    flash(pair, GOOD["three"])
    pair.keep_calibration(bytes(range(100)))
    pair.revert()
    pair.announce(WRONG["any"], bytes(32))
    pair.boot()
    pair.keep_calibration(bytes(30))


def given_up(pair: Pair) -> None:
    """A release is put on trial and never confirmed."""
    transfer(pair, GOOD["two"], 1000)
    pair.finish()
    pair.activate()
    pair.activate()
    for _ in range(4):
        pair.boot()


def refused(pair: Pair) -> None:
    """A release by a stranger, then one that is left half way, then another key list."""
    for name in ("signature", "stranger"):
        transfer(pair, WRONG[name], 700)
        pair.finish()
    pair.activate()
    transfer(pair, LONG, 1700, 9_000)
    pair.drop()
    transfer(pair, LONG, 1700)
    pair.take_keys(LISTS[4])
    pair.keep_failed_attempts(Level.PROGRAMMING, 2)
    for length in range(8, 32):
        pair.keep_faults(bytes(length))


STORIES: Final[tuple[Callable[[Pair], None], ...]] = (updated, given_up, refused)


def recovered(pair: Pair) -> None:
    """Whatever was cut: release "two" can be flashed, and runs confirmed after the next boot."""
    if pair.store.state.on_trial is not None:
        pair.revert()
    pair.boot()
    if not runs(pair):
        flash(pair, GOOD["two"], 900)
        pair.boot()
    if not runs(pair):
        raise MismatchError("bricked", f"release two was not flashed: {pair.store.state}")


def runs(pair: Pair) -> bool:
    running = pair.store.running
    slot = None if running is None else pair.store.state.slots[running]
    return slot is not None and (slot.name, slot.phase) == ("two", Phase.CONFIRMED)


class Cuts:
    """All cuts of all stories up to one with a finding, and what came of them: counts, and findings in words."""

    def __init__(self, library: Library) -> None:
        self._library = library
        self.counts = Counter(
            dict.fromkeys(("cuts_depth_1", "cuts_depth_2", "bricked", "confirmed_lost", "unsigned", "mismatches"), 0)
        )
        self.findings: list[str] = []

    def all(self, seed: int, *, every: int = 1, seconds: int = 1) -> None:
        """Cut in every operation, or in each one of so many; each with so many second cuts in its recovery."""
        for number, story in enumerate(STORIES):
            begin, end = self._length(story)
            for at in range(begin + seed % every, end, every):
                if self.findings:
                    return
                self._cut(story, at, None, seed + at)
                random = Random(f"{seed}.{number}.{at}")
                for _ in range(seconds):
                    self._cut(story, at, random.randrange(300), seed + at)

    def _length(self, story: Callable[[Pair], None]) -> tuple[int, int]:
        pair = Pair(self._library)
        provision(pair)
        begin = pair.operations
        story(pair)
        return begin, pair.operations

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
