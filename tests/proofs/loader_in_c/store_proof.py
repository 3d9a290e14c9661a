"""The figures of the store in C: cuts, calls, altered images, planted faults, branches."""

import hashlib
import tempfile
from collections import Counter
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path
from random import Random
from typing import Any, Final

from can_bridge.flashing.access_level import Level
from contract.release import signing
from tests.proofs.command_line import in_parts, spread, track
from tests.proofs.ecu_in_c.branch_coverage import is_possible
from tests.proofs.loader_in_c import store_fuzz, store_planted
from tests.proofs.loader_in_c.store_coverage import measured
from tests.proofs.loader_in_c.store_library import GOOD, WRONG, Library
from tests.proofs.loader_in_c.store_pair import Pair
from tests.proofs.loader_in_c.store_stories import LISTS, Cuts, any_calls, flash, provision

CALLS: Final = 200
"""Calls of one seed."""
_IMAGES: Final = 5_000


def storage_figures(*, seed: int, processes: int, images: int, calls: int, seconds: int) -> dict[str, Any]:
    """All figures.

    Args:
        seed: of everything.
        processes: at the same time.
        images: that are altered.
        calls: at random.
        seconds: second cuts in the recovery from each first one.
    """
    cuts, findings = Counter[str](), list[str]()
    for counts, found in track(
        spread(partial(_cuts, seed=seed, seconds=seconds), range(8), processes), "cuts", "parts", 8
    ):
        cuts.update(counts)
        findings += found
    called = sum(in_parts(partial(_called, seed=seed), calls, CALLS, processes, "calls"))
    verdicts, different = Counter[str](), list[str]()
    for some, wrong in in_parts(partial(_judged, seed=seed), images, _IMAGES, processes, "images"):
        verdicts.update(some)
        different += wrong
    with tempfile.TemporaryDirectory() as folder:
        planted = store_planted.PLANTED
        missed = [
            one.what for one in track(planted, "planted", "faults") if not store_planted.is_found(one, Path(folder))
        ]
        figures: dict[str, Any] = {
            **cuts, "first_findings": findings[:10], "calls": called, "images": images,
            "image_verdicts": dict(verdicts),
            "image_mismatches": len(different), "planted": len(planted), "planted_missed": missed,
        }  # fmt: skip
        if is_possible():
            taken = measured(Path(folder), exercise)
            figures |= {"branches": taken.branches, "branches_taken": taken.covered, "branches_missed": taken.missed}
    return figures


def vectors() -> Iterator[tuple[bytes, bytes, bytes, str]]:
    """Key, signature, message, and what is expected of published vectors of Ed25519."""
    for line in Path(__file__).with_name("vectors").joinpath("ed25519.txt").read_text().splitlines():
        if not line.startswith("#"):
            *parts, expected = line.split()
            key, signature, message = (bytes.fromhex(part.strip("-")) for part in parts)
            yield key, signature, message, expected


def verdicts_on_vectors(library: Library) -> Counter[tuple[str, bool, bool]]:
    """How many are expected to be valid, are good to Python, and are good to C."""
    found = Counter[tuple[str, bool, bool]]()
    for key, signature, message, expected in vectors():
        python = signing.is_good(signature, key, message)
        # In C a signature has 64 bytes: there is no other place for it.
        is_good = len(signature) == 64 and library.c.sw_signature_is_good(signature, key, message, len(message))
        found[expected, python, bool(is_good)] += 1
    return found


def exercise(library: Library) -> None:
    """A bit of everything."""
    for seed in range(12):
        any_calls(Pair(library), f"branches {seed}", CALLS)
    Cuts(library).all(1, every=3)
    worn(library)
    verdicts_on_vectors(library)
    for one in (*GOOD.values(), *WRONG.values()):
        for listed in LISTS:
            library.judge(one, listed)


def worn(library: Library) -> None:
    """Words that are worn: a record goes into the next place, an image's word fails, and then it is flashed again."""
    for after in range(0, 600, 11):
        pair = Pair(library, seed=after)
        provision(pair)
        pair.wear(after)
        for count in range(1, 40):
            pair.keep_failed_attempts(Level.PROGRAMMING, count)
        pair.boot()
    for after in range(12):
        pair = Pair(library, seed=after)
        provision(pair)
        whole = GOOD["two"]
        pair.announce(whole, hashlib.sha256(whole).digest())
        pair.wear(after, in_slot=True)
        assert not pair.append(whole[: 13 * 32])
        flash(pair, whole)
        assert pair.store.state.active == 1


@cache
def _library() -> Library:
    """One for each process."""
    with tempfile.TemporaryDirectory() as folder:
        return Library(Path(folder) / "store.so")


@cache
def _program() -> tuple[Any, Path]:
    folder = tempfile.TemporaryDirectory()
    store_fuzz.program(Path(folder.name) / "fuzz")
    return folder, Path(folder.name) / "fuzz"


def _cuts(part: int, *, seed: int, seconds: int) -> tuple[Counter[str], list[str]]:
    cuts = Cuts(_library())
    cuts.all(seed + part, every=8, seconds=seconds)
    return cuts.counts, cuts.findings


def _called(part: range, *, seed: int) -> int:
    any_calls(Pair(_library()), f"{seed} {part.start}", len(part))
    return len(part)


def _judged(part: range, *, seed: int) -> tuple[Counter[str], list[str]]:
    return store_fuzz.fuzz(_program()[1], Random(f"{seed} {part.start}").randrange(2**32), len(part))
