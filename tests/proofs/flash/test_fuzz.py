from contextlib import suppress
from dataclasses import asdict, replace

import pytest

from benchmarks.flash import fuzz, fuzz_images
from benchmarks.flash.fuzz_ecu import FuzzedEcu
from can_bridge.flashing import checking, remembered
from can_bridge.flashing.backing import Kind, Slot
from can_bridge.flashing.remembered import Remembered
from can_bridge.flashing.state import TRIAL_BOOTS, Phase
from can_bridge.flashing.store import Store
from can_bridge.uds import security
from can_bridge.uds.programming import Programming
from can_bridge.uds.server import UdsServer
from contract.errors import KeyFileError
from contract.release import bundle, key_list, signing

VIOLATIONS = (
    "exceptions",
    "unlocked_without_key",
    "attempts_in_delay",
    "activated_unsigned",
    "key_lists_taken_wrongly",
    "releases_lost",
    "stuck",
)


def violations(found: fuzz.FuzzFigures) -> set[str]:
    return {name for name in VIOLATIONS if asdict(found)[name]}


def planted() -> set[str]:
    """What is found of a defect that a test planted."""
    return violations(fuzz.fuzz(40_000, seed=3, until_found=True))


@pytest.fixture(scope="module")
def sound() -> fuzz.FuzzFigures:
    return fuzz.fuzz(20_000, seed=3)


def test_nothing_is_found(sound):
    assert sound.failures == []
    assert violations(sound) == set()


def test_requests_reach_every_service_and_phase(sound):
    assert sound.requests == 20_000
    services = {"0x10", "0x11", "0x22", "0x27", "0x2e", "0x31", "0x34", "0x36", "0x37", "0x3e"}
    for service in services:
        assert sound.by_service[service]["positive"] > 0, service
    assert sound.by_service.keys() == services | {"others"}
    assert {
        "CHECKED",
        "TRIAL",
        "CONFIRMED",
        "boot: TRIAL",
        "key lists",
        "right keys",
        "wrong keys",
    } <= sound.steps.keys()


def test_same_seed_same_requests():
    assert fuzz.fuzz(2000, seed=5) == fuzz.fuzz(2000, seed=5)
    assert fuzz.fuzz(2000, seed=5) != fuzz.fuzz(2000, seed=6)


def test_an_exception_is_counted_and_told(monkeypatch):
    monkeypatch.setattr(UdsServer, "_read", lambda self, body: 1 // 0)
    found = fuzz.fuzz(3000, seed=3)
    assert found.exceptions > 0
    assert "ZeroDivisionError" in found.failures[0]


def test_key_of_zeros_that_is_taken(monkeypatch):
    monkeypatch.setattr(security, "compare_digest", lambda right, given: given in (right, bytes(16)))
    assert planted() == {"unlocked_without_key"}


def test_seed_that_is_good_twice(monkeypatch):
    unlock = security.SecurityAccess.unlock

    def kept(self, now_ns, level, answer):
        asked = self._asked
        try:
            unlock(self, now_ns, level, answer)
        finally:
            self._asked = asked

    monkeypatch.setattr(security.SecurityAccess, "unlock", kept)
    monkeypatch.setattr(security.SecurityAccess, "lock", lambda self: setattr(self, "_unlocked", None))
    assert "unlocked_without_key" in planted()


def test_session_that_ends_unlocked(monkeypatch):
    monkeypatch.setattr(security.SecurityAccess, "lock", lambda self: None)
    assert "unlocked_without_key" in planted()


def test_attempts_that_are_not_kept(monkeypatch):
    monkeypatch.setattr(Programming, "keep_failed_attempts", lambda self, level, count: None)
    assert planted() == {"attempts_in_delay"}


def test_delay_that_a_reset_ends(monkeypatch):
    monkeypatch.setattr(security.SecurityAccess, "power_on", lambda self, now_ns: None)
    assert planted() == {"attempts_in_delay"}


def test_image_that_is_activated_without_a_check(monkeypatch):
    def activate(self):
        for slot, standing in zip(Slot, self.state.slots, strict=True):
            if standing.phase == Phase.FILLING and standing.received == standing.length:
                trial = replace(standing, phase=Phase.TRIAL, boots_left=TRIAL_BOOTS, name="x", signer=bytes(32))
                self._remembered.keep_slot(slot, trial)

    monkeypatch.setattr(Store, "activate", activate)
    assert "activated_unsigned" in planted()


def test_stranger_s_signature_that_is_taken(monkeypatch):
    verified, stranger = bundle.verified, signing.public_key(fuzz_images.STRANGER)
    monkeypatch.setattr(checking, "verified", lambda name, files, trusted: verified(name, files, trusted | {stranger}))
    assert planted() == {"activated_unsigned"}


def test_old_release_that_is_taken(monkeypatch):
    rules = checking.Rules
    monkeypatch.setattr(remembered, "Rules", lambda **given: rules(**{**given, "least_security_version": 0}))
    assert planted() == {"activated_unsigned"}


def test_confirmation_without_a_trial(monkeypatch):
    def confirm(self):
        for slot, standing in zip(Slot, self._store.state.slots, strict=True):
            if standing.phase == Phase.CHECKED:
                self._store._confirm(slot)

    monkeypatch.setattr(Programming, "_confirm", confirm)
    assert planted() == {"activated_unsigned"}


def test_key_list_that_nobody_looked_at(monkeypatch):
    def take(self, raw, needed):
        self.backing.keep(Kind.KEYS, raw)
        with suppress(KeyFileError):
            self.keys = key_list.decode(raw, self._root)

    monkeypatch.setattr(Remembered, "take_keys", take)
    assert "key_lists_taken_wrongly" in planted()


def test_confirmed_release_that_is_written_over(monkeypatch):
    monkeypatch.setattr(Store, "_writable_slot", lambda self: self.state.active or Slot.A)
    assert planted() & {"releases_lost", "activated_unsigned"}


def test_work_that_does_not_end(monkeypatch):
    def endless(self):
        while True:
            yield

    monkeypatch.setattr(FuzzedEcu, "self_test", endless)
    assert planted() == {"stuck"}
