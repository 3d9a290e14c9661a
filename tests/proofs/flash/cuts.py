"""The supply cut at every write of flashing a release: whether the ECU ever stands without a controller it can trust.

The tester's own steps drive the UDS server, the store and a simulated memory, with the shipped release. Each operation
of the memory is torn in its middle once; in the recovery from each, some are torn again. After every power-on the image
that runs is checked as the ECU checks it, by its signature and every hash, and compared with the releases byte by byte;
then the same release is flashed again.

Each case has a name, by which `--replay` plays it again: 0.123 is the cut in call 123 to the folder's files in the
whole sequence, with seed 0 of what it leaves behind; 0.123.45 has a second one in call 45 after that power-on.
"""

import re
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from random import Random
from time import perf_counter
from typing import Annotated, Any, Final, NamedTuple

import typer

from benchmarks.common.command_line import console, track
from can_bridge.flashing.backing import MediumError, Slot
from can_bridge.flashing.state import TRIAL_BOOTS, SlotPhase
from can_bridge.flashing.store import BootReason
from can_bridge.tester.sequence import End, Flashed, Flashing, Step
from contract.errors import StillwakeError
from contract.release import bundle
from contract.release.container import image_of, read_files
from contract.shipped import BUNDLE
from tests.can_bridge.flashing.releases import RELEASE, provision
from tests.can_bridge.flashing.store_ecu import StoreEcu
from tests.can_bridge.tester.line import Line
from tests.proofs.command_line import JsonFile, report, spread
from tests.proofs.flash.places import FolderPlace

OLD, NEW = 1, 2  # security versions of the two releases
KINDS: Final = ("bricked", "wrong_release", "confirmed_lost", "counter_moved", "checkpoint_lost", "reflash_failed")
PIECE: Final = 100  # cuts that a process makes in one go; it repeats the sequence for them
Case = tuple[int, ...]
"""The seed of what the cut leaves behind, the operation of the sequence in which the supply is cut, and the one after
the power-on, if there is a second cut."""


def name_of(case: Case) -> str:
    return ".".join(map(str, case))


def case_of(name: str) -> Case:
    """Raises StillwakeError for what is no case's name."""
    if not re.fullmatch(r"\d+\.\d+(\.\d+)?", name):
        raise StillwakeError(f"case {name!r}: must be such as 0.123 or 0.123.45")
    return tuple(map(int, name.split(".")))


@dataclass
class Asked:
    """How far the tester had come, by which is known what may be found after a cut."""

    received: int = 0  # bytes that the ECU acknowledged
    activated: bool = False  # whether it was asked for
    confirmed: bool = False

    def on_step(self, step: Step) -> None:
        self.activated |= step is Step.ACTIVATE
        self.confirmed |= step is Step.CONFIRM

    def progress(self, received: int, _: int) -> None:
        self.received = received


class Finding(NamedTuple):
    case: Case
    kind: str  # one of `KINDS`
    text: str


@dataclass
class Tally:
    """What came of the cases, each told to `report`."""

    cases: Counter[int] = field(default_factory=Counter)  # by depth
    findings: list[Finding] = field(default_factory=list)
    operations: int = 0  # of the whole sequence without a cut
    boots: int = 0  # each checks the image that it boots
    report: Callable[[str], None] | None = None

    def boot(self, case: Case, place: FolderPlace, before: str) -> StoreEcu:
        ecu = StoreEcu(place.backing)
        self.boots += 1
        if self.report is not None:
            booted = "no slot" if ecu.boot.slot is None else ecu.boot.slot.name
            slots = zip(Slot, ecu.store.state.slots, strict=True)
            states = ", ".join(f"{slot.name} {one.phase.name} {one.received}/{one.length}" for slot, one in slots)
            self.report(f"{name_of(case)}: {before}; booted: {booted}, {ecu.boot.reason.in_words}; {states}")
        return ecu


@cache
def shipped(security_version: int) -> bytes:
    """The image of the shipped release, renewed under the key of the tests with this security version."""
    with tempfile.TemporaryDirectory() as folder:
        target, name = Path(folder) / "bundle", f"bench-{security_version}"
        bundle.renew(BUNDLE, target, name=name, created="2026-01-01", key=RELEASE, security_version=security_version)
        return image_of(read_files(target))


def walk(
    seed: int,
    at: Callable[[int], bool],
    then: Callable[[int, int], bool] = lambda first, second: False,
    tally: Tally | None = None,
) -> Tally:
    """The whole sequence, with a case for each operation of its number that `at` picks, and a further one for each that
    `then` picks in the recovery from it. The seed is of what cuts leave behind; a `tally` is gone on with."""
    place, tally, asked = FolderPlace(seed), tally or Tally(), Asked()
    provision(place.backing(), shipped(OLD))
    begin = place.operations

    def on_cut(number: int, torn: FolderPlace) -> None:
        tally.cases[1] += 1
        first = number - begin
        recover((seed, first), torn, asked, tally, lambda second: then(first, second))

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
        recover((*case, number - begin), torn, asked, tally)

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
    if flashed.resumed_from is not None and flashed.resumed_from < had:
        wrong("checkpoint_lost", f"{had} bytes were acknowledged, the transfer began again at {flashed.resumed_from}")
    place.branch(lambda number: False, None)
    after = tally.boot(case, place, f"flashed again: {flashed.end.name}, from byte {flashed.resumed_from}")
    if flashed.end not in (End.CONFIRMED, End.ALREADY) or after.boot.reason is not BootReason.CONFIRMED:
        wrong("reflash_failed", f"it ended {flashed.end.name}, then booted {after.boot.reason.in_words}")
    _judge(after, place.twin(), Asked(0, activated=True, confirmed=True), wrong)
    if _running(after, place) != NEW:
        wrong("reflash_failed", "the old release runs after the new one was flashed again")


def _flash(ecu: StoreEcu, asked: Asked) -> Flashed:
    return Flashing(Line(ecu).asking(), shipped(NEW), progress=asked.progress, on_step=asked.on_step).run()


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
    try:
        content = place.backing().read(slot, 0, length)
    except MediumError:
        return None
    return next((version for version in (OLD, NEW) if content == shipped(version)), None)


def main(
    json_file: JsonFile = None,
    replay: Annotated[str, typer.Option(help="Play one case again, such as 0.123.45.")] = "",
    every: Annotated[int, typer.Option(help="Cut in every so manieth operation; 1: in each.", min=1)] = 1,
    seeds: Annotated[int, typer.Option(help="Ways in which each call to the folder is torn.", min=1)] = 4,
    second_cuts: Annotated[
        float, typer.Option(help="Second cuts, were a recovery as long as the sequence.", min=0.0)
    ] = 1.0,
    workers: Annotated[int, typer.Option(help="Processes; the cases are the same for any number.", min=1)] = 2,
) -> None:
    """Cut the power at every write of the store, switch on and flash again; nothing may be lost."""
    if replay:
        _replay(case_of(replay))
        return
    began = perf_counter()
    operations = walk(0, lambda number: False).operations
    of = -(-operations // (PIECE * every))
    pieces = [(seed, number) for seed in range(seeds) for number in range(0, of * every, every)]
    work = partial(run_piece, of=of * every, share=second_cuts / operations)
    tallies = list(track(spread(work, pieces, workers), "cuts", "parts", len(pieces)))
    cases = sum((one.cases for one in tallies), Counter[int]())
    findings = [finding for one in tallies for finding in one.findings]
    lost = Counter(finding.kind for finding in findings)
    figures = {
        "operations": operations, "cuts_depth_1": cases[1], "cuts_depth_2": cases[2],
        "boots": sum(one.boots for one in tallies), **{kind: lost[kind] for kind in KINDS},
        "cases_lost": [name_of(finding.case) for finding in findings][:20],
        "seconds_proof": perf_counter() - began,
    }  # fmt: skip
    facts: dict[str, Any] = {"every": every, "seeds": seeds, "second_cuts": second_cuts, "workers": workers}
    report(json_file, "flash", figures, packages=("stillwake", "onnxruntime", "cryptography", "udsoncan"), **facts)
    if findings:
        case, kind, text = findings[0]
        raise StillwakeError(f"{len(findings)} findings, the first: {name_of(case)}, {kind}: {text}")


def run_piece(piece: tuple[int, int], *, of: int, share: float) -> Tally:
    """Some of the cases of one walk, by its seed and a number: every `of`th operation from there on, and a share of the
    second cuts, chosen by their numbers and the seed alone."""
    seed, begin = piece

    def second(first: int, number: int) -> bool:
        return Random(f"{seed} {first} {number}").random() < share

    return walk(seed, lambda number: number % of == begin, second)


def _replay(case: Case) -> None:
    tally = Tally(report=console.print)
    seed, cut, *again = case
    walk(seed, lambda number: number == cut, lambda first, second: second in again, tally)
    for finding in tally.findings:
        console.print(f"{name_of(finding.case)}: {finding.kind}: {finding.text}")
    if not any(tally.cases.values()):
        raise StillwakeError(f"case {name_of(case)}: the sequence has {tally.operations} operations; name one of them")
    if not tally.findings:
        console.print(f"{name_of(case)}: nothing was lost")
