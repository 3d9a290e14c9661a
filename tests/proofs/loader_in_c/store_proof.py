"""The figures of the store in C: cuts, calls, altered images, planted faults, branches."""

import hashlib
import struct
import subprocess
import tempfile
from collections import Counter
from collections.abc import Iterator
from functools import partial
from itertools import product
from pathlib import Path
from random import Random
from typing import Any, Final

from benchmarks.common.command_line import track
from can_bridge.flashing import checking
from can_bridge.flashing.backing import RecordKind, Slot
from can_bridge.flashing.state import Level
from can_bridge.flashing.verdicts import Verdict
from contract.release import key_list, signing
from contract.release.signing import public_key
from tests.can_bridge.flashing.releases import RELEASE, ROOT, SECOND, STRANGER, keys
from tests.proofs.command_line import in_parts
from tests.proofs.ecu_in_c.branch_coverage import branches, is_possible, without_reason
from tests.proofs.ecu_in_c.planted import Planted, listed
from tests.proofs.loader_in_c import store_library
from tests.proofs.loader_in_c.node_library import build
from tests.proofs.loader_in_c.store_forged import forged, logs
from tests.proofs.loader_in_c.store_library import FLAGS, GOOD, LONG, MEASURED, RULES, SETTINGS, WRONG, Library, sources
from tests.proofs.loader_in_c.store_pair import DONE, FIRST_RECORD, Pair
from tests.proofs.loader_in_c.store_stories import LISTS, RARE, Cuts, any_calls, cared, flash, provision, transfer

SANITISED: Final = (*FLAGS, "-DTWIN_FUZZ", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
LIST: Final = keys(1, RELEASE, revoked=(SECOND,))
_BASES: Final = (*GOOD.values(), *WRONG.values())
_EDGES: Final = (0, 8, 12, 16, 48, 80, 112, 144, 148, 156, 180, 188, 192, 256, 320, 416, 448, 480, 511)
_OUT_OF_RANGE: Final = 0x82


def images(seed: int, count: int) -> Iterator[bytes]:
    """Images in order, damaged, cut, joined, or altered and signed again."""
    random = Random(seed)
    for _ in range(count):
        found = bytearray(random.choice(_BASES if random.random() < 0.95 else (LONG,)))
        kind = random.randrange(6)
        if kind == 0:
            for _ in range(random.choice((1, 1, 2, 9))):
                found[random.randrange(len(found))] ^= 1 << random.randrange(8)
        elif kind == 1:
            found = found[: random.randrange(len(found) + 1)]
        elif kind == 2:
            found += random.randbytes(random.choice((1, 31, 700, store_library.SLOT_BYTES)))
        elif kind == 3:
            at = random.choice(_EDGES)
            found = found[:at] + bytearray(random.choice(_BASES))[at:]
        elif len(found) >= 512:
            at = random.choice(_EDGES[:-3]) + random.choice((0, 0, 1, 3))
            value = random.choice((b"\0", b"\xff", b"A", random.randbytes(4), random.randbytes(40)))
            key = random.choice((RELEASE, RELEASE, RELEASE, SECOND, STRANGER))
            if random.random() < 0.3:
                found[16:48] = hashlib.sha256(found[512:]).digest()
            found = bytearray(store_library.resigned(bytes(found), at, value[: 416 - at], key))
        yield bytes(found)


def fuzz(program: Path, seed: int, count: int) -> tuple[Counter[str], list[str]]:
    """Verdicts with their counts, and images that both judge differently; RuntimeError if a sanitiser ended it."""
    made = list(images(seed, count))
    head = RULES + struct.pack(">I", len(LIST)) + LIST
    sent = head + b"".join(struct.pack(">I", len(one)) + hashlib.sha256(one).digest() + one for one in made)
    done = subprocess.run([program], input=sent, capture_output=True, check=False)
    if done.returncode or len(done.stdout) != count:
        raise RuntimeError(f"status {done.returncode} behind {len(done.stdout)} images: {done.stderr[:500]!r}")
    allowed = key_list.decode(LIST, public_key(ROOT))
    given = checking.Rules(keys=allowed, hardware=SETTINGS["hardware"], fits=SETTINGS["fits"], least_security_version=1)
    counts, different = Counter[str](), list[str]()
    for one, in_c in zip(made, done.stdout, strict=True):
        is_judged = 0 < len(one) <= store_library.SLOT_BYTES
        verdict = store_library.judged(one, given)[0] if is_judged else _OUT_OF_RANGE
        counts[Verdict(verdict).name if is_judged else "refused"] += 1
        if verdict != in_c:
            different.append(f"{verdict} in Python, {in_c} in C: {one[:512].hex()}")
    return counts, different


CALLS: Final = 200  # calls of one seed
_IMAGES: Final = 5_000
UNREACHED: Final = {
    ("sw_records.c", "gathered(records, of, begin,"): "the call has just read them; they would have to fail in between"
}
PLANTED: Final = listed(Path(__file__).with_name("store_planted.toml"))


def is_found(item: Planted, folder: Path) -> bool:
    """By calls at random, by care for records, by forged records, or by cuts."""
    # A planted fault may look odd to the compiler.
    library = Library(build(item.into(sources()), folder, f"planted_{PLANTED.index(item)}.so", (*FLAGS, "-w")))
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
    *, seed: int, processes: int, images: int, calls: int, records: int, seconds: int, eighths: int
) -> dict[str, Any]:
    """All figures: of altered images, random calls, forged records and as many logs, a supply cut in `eighths` of the
    memory's operations and `seconds` times in the recovery from each, planted faults, and branches."""
    cuts, findings, verdicts, different = Counter[str](), list[str](), Counter[str](), list[str]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        store, program = build(sources(), folder, "store.so", FLAGS), build(sources(), folder, "fuzz", SANITISED)
        for counts, found in in_parts(partial(_cuts, store, seed, seconds), eighths, 1, processes, "cuts"):
            cuts.update(counts)
            findings += found
        called = sum(in_parts(partial(_called, store, seed), calls, CALLS, processes, "calls"))
        tried = list(in_parts(partial(_forged, store, seed), records, CALLS, processes, "records"))
        for counts, found in in_parts(partial(_judged, program, seed), images, _IMAGES, processes, "images"):
            verdicts.update(counts)
            different += found
        figures: dict[str, Any] = {
            **cuts, "first_findings": findings[:10], "calls": called,
            "forged_records": sum(one for one, _ in tried), "forged_that_run": sum(one for _, one in tried),
            "forged_logs": sum(one for one, _ in tried), "images": images,
            "image_verdicts": dict(verdicts), "image_mismatches": len(different),
            "planted": len(PLANTED),
            "planted_missed": [one.what for one in track(PLANTED, "planted", "faults") if not is_found(one, folder)],
        }  # fmt: skip
        if is_possible():
            figures |= branch_figures(folder / "branches")
    return figures


def branch_figures(folder: Path) -> dict[str, Any]:
    """Branches of the store's C: all, those that `exercise` takes, those that `UNREACHED` explains, and the places of
    the others, `file:line: text`, with what it has without need."""
    flags = (*FLAGS, "-O0", "--coverage", "-DTWIN_COVERAGE")
    library = Library(build(sources(), folder, "store.so", flags))
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
    for one, allowed in product(_BASES, LISTS):
        library.judge(one, allowed)


def worn(library: Library) -> None:
    """Words that are worn: a record goes into the next place, and the others without one that is lost; an image's word
    fails, and then it is flashed again."""
    for after in range(0, 600, 11):
        pair = Pair(library, seed=after)
        pair.call("keep_faults", b"lost")
        provision(pair)
        pair.spoil(Slot.A, FIRST_RECORD, readable=False)
        pair.store.faults = pair.flash.kept.pop(RecordKind.FAULTS)[:0]
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
