"""Flash an ECU with the supply cut in one operation, and in another during the recovery, and judge what comes of it.

Each case has a name (`benchmarks.flash.case`) and can be played again by it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

from udsoncan.client import Client

from benchmarks.flash import releases
from benchmarks.flash.bench_ecu import BenchEcu
from benchmarks.flash.case import Case
from benchmarks.flash.places import FlashPlace, FolderPlace, Place
from benchmarks.flash.quick_graphs import graphs_judged_once
from can_bridge.flashing.backing import Kind, Slot
from can_bridge.flashing.boot import BootReason
from can_bridge.flashing.medium import MediumError
from can_bridge.flashing.state import TRIAL_BOOTS, Phase, SlotState
from can_bridge.flashing.store import Store
from can_bridge.tester.sequence import End, Flashed, Step, flash
from can_bridge.uds.access_key import AccessKey
from contract.errors import StillwakeError

OLD: Final = 1
NEW: Final = 2
"""Security versions of the two releases."""
PLACES: Final[dict[str, Callable[[int], Place]]] = {"flash": FlashPlace, "folder": FolderPlace}
_LOG_WORDS: Final = 330
"""Left in the log's sector when the sequence begins: less than the sequence writes, so that the log moves in it."""


@dataclass
class Asked:
    """How far the tester had come: what may be found after a cut.

    Attributes:
        received: bytes that the ECU acknowledged.
        activated, confirmed: whether it was asked for.
    """

    received: int = 0
    activated: bool = False
    confirmed: bool = False

    def say(self, step: Step) -> None:
        self.activated |= step is Step.ACTIVATE
        self.confirmed |= step is Step.CONFIRM

    def progress(self, received: int, _: int) -> None:
        self.received = received


@dataclass(frozen=True)
class Finding:
    """What went wrong in a case; `kind` is one of `KINDS`."""

    case: Case
    kind: str
    text: str


KINDS: Final = ("bricked", "wrong_release", "confirmed_lost", "counter_moved", "checkpoint_lost", "reflash_failed")


@dataclass
class Tally:
    """Cases by depth, and what went wrong in them.

    Attributes:
        spoilt: cases in which no supply was cut and both slots were spoilt.
        operations: of the whole sequence without a cut.
        boots: each of which checked the image that it booted.
        tell: hears what happens in each case.
    """

    cases: dict[int, int] = field(default_factory=lambda: {1: 0, 2: 0})
    findings: list[Finding] = field(default_factory=list)
    operations: int = 0
    boots: int = 0
    spoilt: int = 0
    tell: Callable[[str], None] | None = None

    def add(self, other: "Tally") -> None:
        for depth, count in other.cases.items():
            self.cases[depth] += count
        self.findings += other.findings
        self.boots += other.boots
        self.spoilt += other.spoilt
        self.operations = max(self.operations, other.operations)


def provisioned(kind: str, seed: int) -> Place:
    """An ECU's memory with the old release confirmed, after a life of some years: another one was in it before."""
    place = PLACES[kind](seed)
    store = Store.provision(
        place.backing(),
        root=releases.ROOT,
        keys=releases.keys(),
        image=releases.image(OLD),
        hardware=releases.HARDWARE,
        fits=releases.fits,
    )
    store.boot()
    if isinstance(place, FlashPlace):
        _fill_log(place)
    return place


def walk(
    kind: str,
    seed: int,
    at: Callable[[int], bool],
    then: Callable[[int, int], bool] = lambda first, second: False,
    tally: Tally | None = None,
) -> Tally:
    """The whole sequence, with a case for each operation that `at` picks.

    Args:
        kind: of `PLACES`.
        seed: of what cuts leave behind.
        at: whether to cut in the operation with this number of the sequence.
        then: whether to cut in the second operation during the recovery from the first one.
        tally: to count in, in place of a new one.
    """
    place, tally = provisioned(kind, seed), tally or Tally()
    begin, asked = place.operations, Asked()

    def on_cut(number: int, torn: Place) -> None:
        tally.cases[1] += 1
        first = number - begin
        recover(Case(kind, seed, first), torn, asked, tally, lambda second: then(first, second))

    place.branch(lambda number: at(number - begin), on_cut)
    with graphs_judged_once():
        _flash(place, asked)
    tally.operations = place.operations - begin
    return tally


def recover(
    case: Case, place: Place, before: Asked, tally: Tally, then: Callable[[int], bool] = lambda number: False
) -> None:
    """Power on after a cut, judge, flash again, judge; with a further case for each operation that `then` picks."""
    begin = place.operations
    asked = Asked(before.received, before.activated, before.confirmed)

    def on_cut(number: int, torn: Place) -> None:
        tally.cases[2] += 1
        recover(replace(case, second=number - begin), torn, asked, tally)

    def wrong(kind: str, text: str) -> None:
        tally.findings.append(Finding(case, kind, text))

    def tell(text: str) -> None:
        if tally.tell is not None:
            tally.tell(f"{case}: {text}")

    place.branch(lambda number: then(number - begin), on_cut)
    ecu = BenchEcu(place.backing)
    tally.boots += 1
    tell(f"the tester had {before.received} bytes acknowledged; booted: {_in_words(ecu)}")
    _judge(ecu, place.twin(), asked, wrong)
    had = asked.received if not asked.activated else 0
    try:
        flashed = _flash(place, asked, ecu)
    except StillwakeError as error:
        wrong("reflash_failed", str(error))
        return
    if flashed.transferred is not None and flashed.transferred.resumed_from < had:
        wrong("checkpoint_lost", f"{had} bytes were acknowledged, the transfer began again at {flashed.transferred}")
    tell(f"flashed again: {flashed.end.name}, {flashed.transferred}")
    place.branch(lambda number: False, None)
    after = BenchEcu(place.backing)
    tally.boots += 1
    tell(f"booted: {_in_words(after)}")
    if flashed.end not in (End.CONFIRMED, End.ALREADY) or after.boot.reason is not BootReason.CONFIRMED:
        wrong("reflash_failed", f"it ended {flashed.end.name}, then booted {after.boot.reason.in_words}")
    _judge(after, place.twin(), Asked(0, activated=True, confirmed=True), wrong)
    if _runs(after, place) != NEW:
        wrong("reflash_failed", "the old release runs after the new one was flashed again")


def both_bad(kind: str, seed: int) -> Tally:
    """No slot has an image in order any more: the ECU says so, and can be flashed."""
    place, tally = provisioned(kind, seed), Tally(spoilt=1)
    for slot in Slot:
        _spoil(place, slot)
    ecu = BenchEcu(place.backing)
    tally.boots += 2
    case = Case(kind, seed, None)
    if ecu.boot.bundle is not None or ecu.boot.reason is not BootReason.NO_RELEASE:
        tally.findings.append(Finding(case, "wrong_release", f"spoilt images boot: {_in_words(ecu)}"))
    try:
        _flash(place, Asked(), ecu)
    except StillwakeError as error:
        tally.findings.append(Finding(case, "reflash_failed", str(error)))
    if _runs(BenchEcu(place.backing), place) != NEW:
        tally.findings.append(Finding(case, "bricked", "no release runs after it was flashed"))
    return tally


def _spoil(place: Place, slot: Slot) -> None:
    """Leave a slot's record as it is, and other bytes in its place."""
    backing = place.backing()
    for _ in backing.clear(slot):
        pass
    backing.append(slot, bytes(len(releases.image(OLD))))
    backing.keep(Kind.STATE, backing.records()[Kind.STATE])


def _flash(place: Place, asked: Asked, ecu: BenchEcu | None = None) -> Flashed:
    ecu = BenchEcu(place.backing) if ecu is None else ecu
    return flash(
        Client(ecu),
        releases.image(NEW),
        key=AccessKey(releases.ACCESS).answer,
        progress=asked.progress,
        say=asked.say,
        clock=ecu.clock,
        sleep=ecu.sleep,
    )


def _judge(ecu: BenchEcu, twin: Place, asked: Asked, wrong: Callable[[str, str], None]) -> None:
    """What holds after every power-on.

    A whole release runs, the old one or, once it was to be activated, the new one; the one that was confirmed stands in
    its slot, byte by byte; the least security version is that of a confirmed release; a trial ends by itself.
    """
    state, runs = ecu.store.state, _runs(ecu, twin)
    if ecu.boot.bundle is None:
        wrong("bricked", f"no release runs: {ecu.boot.verdicts}")
        return
    if runs is None or (runs == NEW and not asked.activated):
        wrong("wrong_release", f"{ecu.boot.bundle.manifest.name} runs in slot {ecu.boot.slot}")
    confirmed = None if state.active is None else _stands(twin, state.active, state.slots[state.active].length)
    if confirmed is None or (confirmed == NEW and not asked.confirmed):
        wrong("confirmed_lost", f"the confirmed slot {state.active} has release {confirmed}")
    if state.least_security_version != confirmed:
        wrong("counter_moved", f"it is {state.least_security_version}, of the confirmed release {confirmed}")
    if ecu.boot.slot is not None and state.slots[ecu.boot.slot].phase is Phase.TRIAL:
        for _ in range(TRIAL_BOOTS):
            last = BenchEcu(twin.backing)
        if _runs(last, twin) != confirmed or last.boot.slot != state.active:
            wrong("confirmed_lost", f"after {TRIAL_BOOTS} boots without a confirmation {last.boot.slot} runs")


def _runs(ecu: BenchEcu, place: Place) -> int | None:
    """Which release, by its bytes in the memory."""
    slot = ecu.boot.slot
    return None if slot is None else _stands(place, slot, ecu.store.state.slots[slot].length)


def _stands(place: Place, slot: Slot, length: int) -> int | None:
    """Which release is in a slot, byte by byte."""
    try:
        found = place.backing().read(slot, 0, length)
    except MediumError:
        return None
    return next((version for version in (OLD, NEW) if found == releases.image(version)), None)


def _in_words(ecu: BenchEcu) -> str:
    slots = (f"{slot.name} {state.phase.name} {state.received}/{state.length}" for slot, state in _slots(ecu))
    return f"{'no slot' if ecu.boot.slot is None else ecu.boot.slot.name}, {ecu.boot.reason.in_words}; " + ", ".join(
        slots
    )


def _slots(ecu: BenchEcu) -> list[tuple[Slot, SlotState]]:
    return [(slot, ecu.store.state.slots[slot]) for slot in Slot]


def _fill_log(place: FlashPlace) -> None:
    """Keep the same record until the log's sector is nearly full."""
    backing = place.backing()
    record = backing.records()[Kind.STATE]
    while True:
        trial = place.twin()
        before = sum(trial.erasures)
        opened = trial.backing()
        for _ in range(_LOG_WORDS // (1 + -(-len(record) // 32))):
            opened.keep(Kind.STATE, record)
        if sum(trial.erasures) > before:
            return
        backing.keep(Kind.STATE, record)
