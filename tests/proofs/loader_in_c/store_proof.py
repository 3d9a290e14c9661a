"""The figures of the store in C: cuts, calls, altered images, planted faults, branches."""

import tempfile
import tomllib
from collections import Counter
from functools import partial
from pathlib import Path
from random import Random
from typing import Any, Final

from benchmarks.common.command_line import track
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import RecordKind, Slot
from contract.release import signing
from tests.proofs.command_line import in_parts
from tests.proofs.ecu_in_c.branch_coverage import branches, is_possible, without_reason
from tests.proofs.ecu_in_c.planted import Planted
from tests.proofs.loader_in_c import node_library
from tests.proofs.loader_in_c.store_forged import forged, logs
from tests.proofs.loader_in_c.store_fuzz import SANITISED, fuzz
from tests.proofs.loader_in_c.store_library import GEOMETRY, GOOD, LONG, MEASURED, WRONG, Library, built, sources
from tests.proofs.loader_in_c.store_pair import DONE, FIRST_RECORD, Pair
from tests.proofs.loader_in_c.store_stories import LISTS, RARE, Cuts, any_calls, cared, flash, provision, transfer

CALLS: Final = 200
"""Calls of one seed."""
_IMAGES: Final = 5_000
UNREACHED: Final = {
    ("sw_records.c", "gathered(records, of, begin,"): "the call has just read them; they would have to fail in between"
}
"""Branches that nothing leads to, by the text of their line, and why they stand there all the same."""
PLANTED: Final = tuple(
    Planted(variant="", **item)
    for item in tomllib.loads(Path(__file__).with_name("store_planted.toml").read_text(encoding="utf-8"))["planted"]
)
"""Faults in C, one at a time: the comparison, or the cuts, have to notice every one."""


def is_found(item: Planted, folder: Path) -> bool:
    """By calls at random, by care for records, by forged records, or by cuts."""
    library = Library(built(folder / f"planted_{PLANTED.index(item)}.so", item.into(sources())))
    try:
        for seed in range(6):
            any_calls(Pair(library), str(seed), 150)
        cared(Pair(library))
        forged(Pair(library), "planted", 400)
        logs(library, "planted", 100)
        return bool(Cuts(library, 0, every=5).findings)
    except AssertionError:
        return True


def storage_figures(
    *, seed: int, processes: int, images: int, calls: int, records: int, seconds: int, eighths: int = 8,
    faults: bool = True,
) -> dict[str, Any]:  # fmt: skip
    """All figures: of altered `images`, of `calls` at random, of forged `records` and as many logs, of a supply cut in
    `eighths` of the flash memory's operations and `seconds` times in the recovery from each; with `faults`, of planted
    ones and of branches, too."""
    cuts, findings, verdicts, different = Counter[str](), list[str](), Counter[str](), list[str]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        store, program = built(folder / "store.so"), built(folder / "fuzz", flags=SANITISED)
        for counts, found in in_parts(partial(_cuts, store, seed, seconds), eighths, 1, processes, "cuts"):
            cuts.update(counts)
            findings += found
        called = sum(in_parts(partial(_called, store, seed), calls, CALLS, processes, "calls"))
        tried = list(in_parts(partial(_forged, store, seed), records, CALLS, processes, "records"))
        for counts, found in in_parts(partial(_judged, program, seed), images, _IMAGES, processes, "images"):
            verdicts.update(counts)
            different += found
        planted = track(PLANTED if faults else (), "planted", "faults")
        figures: dict[str, Any] = {
            **cuts, "first_findings": findings[:10], "calls": called,
            "forged_records": sum(one for one, _ in tried), "forged_that_run": sum(one for _, one in tried),
            "forged_logs": sum(one for one, _ in tried), "images": images,
            "image_verdicts": dict(verdicts), "image_mismatches": len(different),
            "planted": len(PLANTED) if faults else 0,
            "planted_missed": [one.what for one in planted if not is_found(one, folder)],
        }  # fmt: skip
        if faults and is_possible():
            figures |= branch_figures(folder / "branches")
    return figures


def branch_figures(folder: Path) -> dict[str, Any]:
    """Branches of the store's C: all, those that `exercise` takes, those that `UNREACHED` explains, and the places of
    the others, `file:line: text`, with what it has without need."""
    flags = ("-O0", "--coverage", "-DTWIN_COVERAGE", *GEOMETRY)
    library = Library(node_library.build(sources(), folder, "store.so", flags))
    exercise(library)
    library.c.twin_dump()
    found = [(file, at, count) for file, at, counts in branches(folder) if file in MEASURED for count in counts]
    missed = [f"{file}:{at}" for file, at, count in found if count == 0]
    others = without_reason(missed, UNREACHED)
    return {
        "branches": len(found), "branches_taken": len(found) - len(missed),
        "branches_explained": sum(one not in others for one in missed), "branches_missed": others,
    }  # fmt: skip


def verdicts_on_vectors(library: Library) -> Counter[tuple[str, bool, bool]]:
    """How many published vectors of Ed25519 are expected to be valid, are good to Python, and are good to C."""
    found = Counter[tuple[str, bool, bool]]()
    for line in Path(__file__).with_name("vectors").joinpath("ed25519.txt").read_text().splitlines():
        if not line.startswith("#"):
            *parts, expected = line.split()
            key, signature, message = (bytes.fromhex(part.strip("-")) for part in parts)
            # In C a signature has 64 bytes: there is no other place for it.
            is_good = len(signature) == 64 and library.c.sw_signature_is_good(signature, key, message, len(message))
            found[expected, signing.is_good(signature, key, message), bool(is_good)] += 1
    return found


def exercise(library: Library) -> None:
    for seed in range(12):
        any_calls(Pair(library), f"branches {seed}", CALLS)
    Cuts(library, 1, every=3)
    worn(library)
    for rare in RARE:
        rare(Pair(library))
    forged(Pair(library), "branches", 3 * CALLS)
    logs(library, "branches", CALLS)
    verdicts_on_vectors(library)
    for one in (*GOOD.values(), *WRONG.values()):
        for listed in LISTS:
            library.judge(one, listed)


def worn(library: Library) -> None:
    """Words that are worn: a record goes into the next place, and the others without one that is lost; an image's word
    fails, and then it is flashed again."""
    for after in range(0, 600, 11):
        pair = Pair(library, seed=after)
        pair.call("keep_faults", b"lost")
        provision(pair)
        pair.spoil(Slot.A, FIRST_RECORD, readable=False)
        pair.store.records.faults = pair.flash.kept.pop(RecordKind.FAULTS)[:0]
        pair.wear(after)
        for count in range(1, 40):
            pair.call("keep_failed_attempts", Level.PROGRAMMING, count)
        pair.boot()
    for after in range(12):
        pair = Pair(library, seed=after)
        provision(pair)
        whole, sent = (GOOD["two"], 0) if after % 2 else (LONG, 8500)
        transfer(pair, whole, 500, sent)
        pair.wear(after, in_slot=True)
        assert pair.call("append", whole[sent : sent + 13 * 32])[0] != DONE
        flash(pair, whole)
        assert pair.store.state.active == 1


def _cuts(store: Path, seed: int, seconds: int, part: range) -> tuple[Counter[str], list[str]]:
    cuts = Cuts(Library(store), seed + part.start, every=8, seconds=seconds)
    return cuts.counts, cuts.findings


def _called(store: Path, seed: int, part: range) -> int:
    any_calls(Pair(Library(store)), f"{seed} {part.start}", len(part))
    return len(part)


def _forged(store: Path, seed: int, part: range) -> tuple[int, int]:
    library = Library(store)
    found = forged(Pair(library), f"{seed} {part.start}", len(part))
    logs(library, f"{seed} {part.start}", len(part))
    return found


def _judged(program: Path, seed: int, part: range) -> tuple[Counter[str], list[str]]:
    return fuzz(program, Random(f"{seed} {part.start}").randrange(2**32), len(part))
