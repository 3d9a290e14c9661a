"""The store in C is the Python store: short runs of what `python -m tests.proofs flash_c` does at length."""

import hashlib

import pytest

from contract.errors import KeyFileError
from contract.release import key_list
from contract.release.signing import public_key
from tests.can_bridge.flashing.releases import ROOT
from tests.proofs.loader_in_c import store_proof
from tests.proofs.loader_in_c.node_library import build
from tests.proofs.loader_in_c.store_forged import forged, logs
from tests.proofs.loader_in_c.store_library import FLAGS, Library, sources
from tests.proofs.loader_in_c.store_pair import Pair
from tests.proofs.loader_in_c.store_stories import LISTS, RARE, Cuts, any_calls

pytestmark = pytest.mark.compiler


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return Library(build(sources(), tmp_path_factory.mktemp("store"), "store.so", FLAGS))


def test_every_call_has_the_same_answer_and_leaves_the_same_store(library):
    for seed in range(2):
        any_calls(Pair(library), str(seed), 50)


def test_a_cut_in_any_operation_leaves_a_state_of_the_specification_and_a_release_that_runs(library):
    cuts = Cuts(library, 0, every=60)
    assert cuts.findings == []
    assert cuts.counts["cuts_depth_1"] > 15 < cuts.counts["cuts_depth_2"] + 10


def test_published_signatures_are_judged_as_in_python(library):
    found = store_proof.verdicts_on_vectors(library)
    assert all(python == c for _, python, c in found)
    assert found["valid", True, True] == 86
    assert found["invalid", False, False] == 63
    # Where libraries differ: an R or a key with a part of small order, and encodings that are not the shortest.
    assert (found["differs", True, True], found["differs", False, False]) == (2, 10)


def test_hashes_are_those_of_hashlib(library):
    raw, digest = bytes(range(251)) * 9, library.ffi.new("uint8_t[32]")
    for length in (0, 1, 3, 55, 56, 57, 63, 64, 65, 119, 120, 128, 1000, 2000):
        library.c.twin_sha256(raw, length, length // 3, digest)
        assert bytes(digest) == hashlib.sha256(raw[:length]).digest()


def test_key_lists_are_judged_as_in_python(library):
    for listed in LISTS:
        try:
            version = key_list.decode(listed, public_key(ROOT)).version
        except KeyFileError:
            version = 0
        assert library.c.twin_keys_version(listed, len(listed), public_key(ROOT).raw) == version


def test_a_forged_record_is_judged_alike_and_the_newest_of_a_log_is_found(library):
    records, run = forged(Pair(library), "quick", 80)
    assert 0 < run < records / 4
    assert 0 < logs(library, "quick", 40) < 20


@pytest.mark.slow  # compiles with sanitisers
def test_altered_images_have_the_same_verdict_and_no_undefined_behaviour(tmp_path):
    counts, different = store_proof.fuzz(build(sources(), tmp_path, "fuzz", (*store_proof.SANITISED, "-O0")), 1, 600)
    assert different == []
    assert len(counts) >= 12, counts


def test_what_is_rare_has_the_same_answer(library):
    for rare in RARE:
        rare(Pair(library))


@pytest.mark.slow  # compiles, and wears hundreds of words
def test_worn_words_are_passed_over(library):
    store_proof.worn(library)


@pytest.mark.slow  # compiles it
def test_a_planted_fault_is_found(tmp_path):
    assert store_proof.is_found(store_proof.PLANTED[13], tmp_path)
