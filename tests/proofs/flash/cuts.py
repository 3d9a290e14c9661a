"""Flash an ECU with the supply cut in one operation, and in another during the recovery, and judge what comes of it.

Each case has a name, by which it can be played again: 0.123 is the cut in call 123 to the folder's files in the whole
sequence, with seed 0 of what it leaves behind; 0.123.45 has a second one in call 45 after that power-on.
"""

import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

from can_bridge.flashing.backing import MediumError, Slot
from can_bridge.flashing.boot import BootReason
from can_bridge.flashing.state import TRIAL_BOOTS, SlotPhase
from can_bridge.tester.sequence import End, Flashed, Step
from contract.errors import StillwakeError
from contract.release import bundle
from contract.release.container import read_files
from contract.release.image import image_of
from contract.shipped import BUNDLE
from tests.can_bridge.flashing.releases import RELEASE, provision
from tests.can_bridge.flashing.store_ecu import StoreEcu
from tests.can_bridge.tester.line import Line, flash_over
from tests.proofs.flash.places import FolderPlace

OLD, NEW = 1, 2
"""Security versions of the two releases."""
KINDS: Final = ("bricked", "wrong_release", "confirmed_lost", "counter_moved", "checkpoint_lost", "reflash_failed")
"""What can go wrong in a case."""


class Case(NamedTuple):
    """One case.

    Attributes:
        seed: of what the cut leaves behind.
        first: operation of the sequence.
        second: operation after the power-on, if there is a second cut.
    """

    seed: int
    first: int
    second: int | None = None

    def __str__(self) -> str:
        return ".".join(str(number) for number in self if number is not None)

    @classmethod
    def parse(cls, name: str) -> "Case":
        """Raises StillwakeError for what is no case's name."""
        try:
            return cls(*map(int, name.split(".")))
        except (ValueError, TypeError):
            raise StillwakeError(f"case {name!r}: must be such as 0.123 or 0.123.45") from None


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

    def on_step(self, step: Step) -> None:
        self.activated |= step is Step.ACTIVATE
        self.confirmed |= step is Step.CONFIRM

    def progress(self, received: int, _: int) -> None:
        self.received = received


class Finding(NamedTuple):
    """What went wrong in a case; `kind` is one of `KINDS`."""

    case: Case
    kind: str
    text: str


@dataclass
class Tally:
    """Cases by depth, and what went wrong in them.

    Attributes:
        operations: of the whole sequence without a cut.
        boots: each of which checked the image that it booted.
        report: called with what happens in each case.
    """

    cases: Counter[int] = field(default_factory=Counter)
    findings: list[Finding] = field(default_factory=list)
    operations: int = 0
    boots: int = 0
    report: Callable[[str], None] | None = None

    def add(self, other: "Tally") -> None:
        self.cases += other.cases
        self.findings += other.findings
        self.boots += other.boots
        self.operations = max(self.operations, other.operations)

    def boot(self, case: Case, place: FolderPlace, before: str) -> StoreEcu:
        """Power on."""
        ecu = StoreEcu(place.backing)
        self.boots += 1
        if self.report is not None:
            self.report(f"{case}: {before}; booted: {_in_words(ecu)}")
        return ecu


@cache
def shipped(security_version: int) -> bytes:
    """The image of the shipped release, renewed under the key of the tests with this security version."""
    with tempfile.TemporaryDirectory() as folder:
        target, name = Path(folder) / "bundle", f"bench-{security_version}"
        bundle.renew(BUNDLE, target, name=name, created="2026-01-01", key=RELEASE, security_version=security_version)
        return image_of(read_files(target))


def provisioned(seed: int) -> FolderPlace:
    """An ECU's memory with the old release confirmed."""
    place = FolderPlace(seed)
    provision(place.backing(), shipped(OLD))
    return place


def walk(
    seed: int,
    at: Callable[[int], bool],
    then: Callable[[int, int], bool] = lambda first, second: False,
    tally: Tally | None = None,
) -> Tally:
    """The whole sequence, with a case for each operation that `at` picks.

    Args:
        seed: of what cuts leave behind.
        at: whether to cut in the operation with this number of the sequence.
        then: whether to cut in the second operation during the recovery from the first one.
        tally: to count in, in place of a new one.
    """
    place, tally = provisioned(seed), tally or Tally()
    begin, asked = place.operations, Asked()

    def on_cut(number: int, torn: FolderPlace) -> None:
        tally.cases[1] += 1
        first = number - begin
        recover(Case(seed, first), torn, asked, tally, lambda second: then(first, second))

    place.branch(lambda number: at(number - begin), on_cut)
    _flash(StoreEcu(place.backing), asked)
    tally.operations = place.operations - begin
    return tally


def recover(
    case: Case, place: FolderPlace, before: Asked, tally: Tally, then: Callable[[int], bool] = lambda number: False
) -> None:
    """Power on after a cut, judge, flash again, judge; with a further case for each operation that `then` picks."""
    begin, asked = place.operations, replace(before)

    def on_cut(number: int, torn: FolderPlace) -> None:
        tally.cases[2] += 1
        recover(case._replace(second=number - begin), torn, asked, tally)

    def wrong(kind: str, text: str) -> None:
        tally.findings.append(Finding(case, kind, text))

    place.branch(lambda number: then(number - begin), on_cut)
    ecu = tally.boot(case, place, f"the tester had {before.received} bytes acknowledged")
    _judge(ecu, place.twin(), asked, wrong)
    had = asked.received if not asked.activated else 0
    try:
        flashed = _flash(ecu, asked)
    except StillwakeError as error:
        wrong("reflash_failed", str(error))
        return
    if flashed.transferred is not None and flashed.transferred.resumed_from < had:
        wrong("checkpoint_lost", f"{had} bytes were acknowledged, the transfer began again at {flashed.transferred}")
    place.branch(lambda number: False, None)
    after = tally.boot(case, place, f"flashed again: {flashed.end.name}, {flashed.transferred}")
    if flashed.end not in (End.CONFIRMED, End.ALREADY) or after.boot.reason is not BootReason.CONFIRMED:
        wrong("reflash_failed", f"it ended {flashed.end.name}, then booted {after.boot.reason.in_words}")
    _judge(after, place.twin(), Asked(0, activated=True, confirmed=True), wrong)
    if _running(after, place) != NEW:
        wrong("reflash_failed", "the old release runs after the new one was flashed again")


def _flash(ecu: StoreEcu, asked: Asked) -> Flashed:
    return flash_over(Line(ecu), shipped(NEW), progress=asked.progress, on_step=asked.on_step)


def _judge(ecu: StoreEcu, twin: FolderPlace, asked: Asked, wrong: Callable[[str, str], None]) -> None:
    """What holds after every power-on.

    A whole release runs, the old one or, once it was to be activated, the new one; the one that was confirmed stands in
    its slot, byte by byte; the least security version is that of a confirmed release; a trial ends by itself.
    """
    state, running = ecu.store.state, _running(ecu, twin)
    if ecu.boot.bundle is None:
        wrong("bricked", f"no release runs: {ecu.boot.verdicts}")
        return
    if running is None or (running == NEW and not asked.activated):
        wrong("wrong_release", f"{ecu.boot.bundle.name} runs in slot {ecu.boot.slot}")
    confirmed = None if state.active is None else _release_in(twin, state.active, state.slots[state.active].length)
    if confirmed is None or (confirmed == NEW and not asked.confirmed):
        wrong("confirmed_lost", f"the confirmed slot {state.active} has release {confirmed}")
    if state.least_security_version != confirmed:
        wrong("counter_moved", f"it is {state.least_security_version}, of the confirmed release {confirmed}")
    if ecu.boot.slot is not None and state.slots[ecu.boot.slot].phase is SlotPhase.TRIAL:
        for _ in range(TRIAL_BOOTS):
            last = StoreEcu(twin.backing)
        if _running(last, twin) != confirmed or last.boot.slot != state.active:
            wrong("confirmed_lost", f"after {TRIAL_BOOTS} boots without a confirmation {last.boot.slot} runs")


def _running(ecu: StoreEcu, place: FolderPlace) -> int | None:
    """Which release, by its bytes in the memory."""
    slot = ecu.boot.slot
    return None if slot is None else _release_in(place, slot, ecu.store.state.slots[slot].length)


def _release_in(place: FolderPlace, slot: Slot, length: int) -> int | None:
    """Which release is in a slot, byte by byte."""
    try:
        content = place.backing().read(slot, 0, length)
    except MediumError:
        return None
    return next((version for version in (OLD, NEW) if content == shipped(version)), None)


def _in_words(ecu: StoreEcu) -> str:
    booted = "no slot" if ecu.boot.slot is None else ecu.boot.slot.name
    slots = zip(Slot, ecu.store.state.slots, strict=True)
    states = [f"{slot.name} {state.phase.name} {state.received}/{state.length}" for slot, state in slots]
    return f"{booted}, {ecu.boot.reason.in_words}; {', '.join(states)}"
