"""The node in C against the flashable ECU: the same frames at the same times; faults that are planted are noticed."""

from collections import Counter
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.cmac import CMAC

from can_bridge.flashing import remembered
from can_bridge.flashing.backing import Kind, Slot
from can_bridge.flashing.checking import Rules
from can_bridge.flashing.remembered import Remembered
from can_bridge.flashing.state import Phase
from can_bridge.flashing.store import Store
from can_bridge.uds import security
from can_bridge.uds.programming import Programming
from can_bridge.uds.security import SecurityAccess
from tests.proofs.ecu_in_c.branch_coverage import is_possible
from tests.proofs.loader_in_c.node_coverage import missed
from tests.proofs.loader_in_c.node_fuzz import SANITISED, VIOLATIONS, corpus, fuzz
from tests.proofs.loader_in_c.node_library import Library, build, sources
from tests.proofs.loader_in_c.node_planted import PLANTED, noticed
from tests.proofs.loader_in_c.node_program import play
from tests.proofs.loader_in_c.node_sizes import sizes
from tests.proofs.loader_in_c.node_twin import CONFIGS, World, world

pytestmark = pytest.mark.compiler
NIST = {
    "": "bb1d6929e95937287fa37d129b756746",
    "6bc1bee22e409f96e93d7e117393172a": "070a16b46b4d4144f79bdd9dd04a287c",
    "6bc1bee22e409f96e93d7e117393172aae2d8a57": "7d85449ea6ea19c823a7bf78837dfade",
}
"""CMAC of messages under the key of NIST SP 800-38B, appendix D.1."""


def confirm_without_a_trial(self: Any) -> None:
    for slot, standing in zip(Slot, self._store.state.slots, strict=True):
        if standing.phase in (Phase.CHECKED, Phase.TRIAL):
            self._store._confirm(slot)


PLANTED_IN_PYTHON = (
    (security, "compare_digest", lambda right, given: given in (right, bytes(16))),
    (SecurityAccess, "lock", lambda self: None),
    (SecurityAccess, "power_on", lambda self, now_ns: None),
    (Remembered, "keep_failed_attempts", lambda self, level, count: None),
    (Remembered, "take_keys", lambda self, raw, needed: self.backing.keep(Kind.KEYS, raw)),
    (remembered, "Rules", lambda rules=Rules, **given: rules(**{**given, "least_security_version": 0})),
    (Store, "_writable_slot", lambda self: self.state.active or Slot.A),
    (Programming, "_confirm", confirm_without_a_trial),
)
"""Owner, name, and what stands there instead: defects of the Python ECU, which the one in C does not have."""


@pytest.fixture(scope="module", params=CONFIGS)
def of(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> World:
    contents = sources(CONFIGS[request.param])
    folder = tmp_path_factory.mktemp("node")
    return world(request.param, Library(contents, build(contents, folder / request.param, f"{request.param}.so")))


def cmac_in_c(of: World, key: bytes, message: bytes) -> bytes:
    found = of.library.ffi.new("uint8_t[16]")
    of.library.c.sw_aes_cmac(key, message, len(message), found)
    return bytes(found)


def test_cmac_is_that_of_nist_and_of_another_library(of: World) -> None:
    key = bytes.fromhex("2b7e151628aed2a6abf7158809cf4f3c")
    assert {message: cmac_in_c(of, key, bytes.fromhex(message)).hex() for message in NIST} == NIST
    for length in range(70):
        key, message = bytes((7 * length + i) % 256 for i in range(16)), bytes(3 * i % 256 for i in range(length))
        other = CMAC(AES(key))
        other.update(message)
        assert cmac_in_c(of, key, message) == other.finalize(), length


@pytest.mark.parametrize("seeds", [8, pytest.param(1000, marks=pytest.mark.proofs)])
def test_both_send_the_same_frames_at_the_same_times(of: World, seeds: int) -> None:
    seen = Counter[str]()
    for seed in range(seeds):
        played = play(of, seed, 60, trouble=(0.001, 0.02, 0.1)[seed % 3])
        assert played.differences == [], seed
        seen += played.seen
    assert {"50", "51", "62", "67", "71", "74"} <= seen.keys() and seen.total() > 30 * seeds


@pytest.mark.parametrize("faults", [PLANTED[1:3], pytest.param(PLANTED, marks=pytest.mark.proofs)])
def test_planted_faults_are_noticed(faults: tuple[tuple[str, str, str], ...], tmp_path: Path) -> None:
    assert [fault for fault in faults if not noticed(fault, tmp_path)] == []


@pytest.mark.proofs  # hundreds of programs
def test_planted_faults_of_the_python_ecu_are_noticed_by_the_one_in_c(of: World) -> None:
    for owner, name, value in PLANTED_IN_PYTHON:
        with patch.object(owner, name, value), pytest.raises(AssertionError):
            for seed in range(300):
                assert play(of, seed, 60, trouble=(0.001, 0.02, 0.1)[seed % 3]).differences == []


@pytest.mark.proofs  # minutes of requests
@pytest.mark.parametrize("requests", [100_000, 1_000_000])
def test_sanitisers_and_the_witness_find_nothing(requests: int, of: World, tmp_path: Path) -> None:
    if of.config.bus.frames != "fd":
        pytest.skip("the program sends CAN FD")
    program = build(sources(of.config), tmp_path / "fuzz", "node_fuzz.c", SANITISED)
    corpus(of, tmp_path / "corpus", range(40))
    counted = fuzz(program, tmp_path / "corpus", requests, requests)
    assert {name: counted[name] for name in VIOLATIONS} == dict.fromkeys(VIOLATIONS, 0)
    assert counted["requests"] == requests and min(counted[name] for name in ("trials", "positive", "pending")) > 0


@pytest.mark.slow  # links it for a Cortex-M7
def test_it_fits(tmp_path: Path) -> None:
    found = sizes(tmp_path)
    assert found["loader_flash_kib"] <= 48 and found["loader_ram_kib"] <= 8 and found["stack_b"] <= 2048, found


@pytest.mark.proofs  # two libraries without optimisation, and gcovr
@pytest.mark.skipif(not is_possible(), reason="gcc, or gcovr (extra dev), is not installed")
def test_every_branch_of_diagnosis_is_taken_or_named(tmp_path: Path) -> None:
    assert missed(tmp_path, range(150)) == []
    (tmp_path / "few").mkdir()
    assert missed(tmp_path / "few", range(1))
