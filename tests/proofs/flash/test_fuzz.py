"""Hostile requests find nothing in the sound server and store, and each planted defect in them."""

from contextlib import suppress
from dataclasses import replace

import pytest

from can_bridge.flashing import checking, remembered
from can_bridge.flashing.backing import Kind, Slot
from can_bridge.flashing.remembered import Remembered
from can_bridge.flashing.state import TRIAL_BOOTS, Phase
from can_bridge.flashing.store import Store
from can_bridge.uds import security
from can_bridge.uds.programming import Programming
from can_bridge.uds.security import SecurityAccess
from can_bridge.uds.server import UdsServer
from contract.errors import KeyFileError
from contract.release import bundle, key_list, signing
from tests.can_bridge.flashing.releases import STRANGER
from tests.can_bridge.flashing.store_ecu import StoreEcu
from tests.proofs.flash.fuzz import VIOLATIONS, FuzzFigures, fuzz

pytestmark = pytest.mark.slow


def violations(figures: FuzzFigures) -> set[str]:
    return {name for name, count in figures.violations.items() if count}


@pytest.mark.proofs  # a campaign of requests
def test_nothing_is_found_and_requests_reach_every_service_and_phase():
    sound = fuzz(12_000, seed=3)
    assert (sound.failures, violations(sound), sound.requests) == ([], set(), 12_000)
    services = {"0x10", "0x11", "0x22", "0x27", "0x2e", "0x31", "0x34", "0x36", "0x37", "0x3e"}
    for service in services:
        assert sound.by_service[service]["positive"] > 0, service
    assert sound.by_service.keys() == services | {"others"}
    reached = {"CHECKED", "TRIAL", "CONFIRMED", "boot: TRIAL", "key lists", "right keys", "wrong keys"}
    assert reached <= sound.steps.keys()
    assert fuzz(1000, seed=5) == fuzz(1000, seed=5) != fuzz(1000, seed=6)


def kept(self, now_ns, level, answer, *, unlock=SecurityAccess.unlock):
    asked = self._asked
    try:
        unlock(self, now_ns, level, answer)
    finally:
        self._asked = asked


def activate_unchecked(self):
    for slot, standing in zip(Slot, self.state.slots, strict=True):
        if standing.phase == Phase.FILLING and standing.received == standing.length:
            trial = replace(standing, phase=Phase.TRIAL, boots_left=TRIAL_BOOTS, name="x", signer=bytes(32))
            self._remembered.keep_slot(slot, trial)


def confirm_without_a_trial(self):
    for slot, standing in zip(Slot, self._store.state.slots, strict=True):
        if standing.phase == Phase.CHECKED:
            self._store._confirm(slot)


def trust_a_stranger(name, files, trusted, *, verified=bundle.verified):
    return verified(name, files, trusted | {signing.public_key(STRANGER)})


def forget_the_least_version(*, rules=checking.Rules, **given):
    return rules(**{**given, "least_security_version": 0})


def take_any_keys(self, raw, needed):
    self.backing.keep(Kind.KEYS, raw)
    with suppress(KeyFileError):
        self.keys = key_list.decode(raw, self._root)


def endless(self):
    while True:
        yield


DEFECTS = (
    ({"unlocked_without_key"}, (security, "compare_digest", lambda right, given: given in (right, bytes(16)))),
    # A seed that is good twice.
    (
        {"unlocked_without_key"},
        (SecurityAccess, "unlock", kept),
        (SecurityAccess, "lock", lambda self: setattr(self, "_unlocked", None)),
    ),
    ({"unlocked_without_key"}, (SecurityAccess, "lock", lambda self: None)),
    ({"attempts_in_delay"}, (Remembered, "keep_failed_attempts", lambda self, level, count: None)),
    ({"attempts_in_delay"}, (SecurityAccess, "power_on", lambda self, now_ns: None)),
    ({"activated_unsigned"}, (Store, "activate", activate_unchecked)),
    ({"activated_unsigned"}, (checking, "verified", trust_a_stranger)),
    ({"activated_unsigned"}, (remembered, "Rules", forget_the_least_version)),
    ({"activated_unsigned"}, (Programming, "_confirm", confirm_without_a_trial)),
    ({"key_lists_taken_wrongly"}, (Remembered, "take_keys", take_any_keys)),
    (
        {"releases_lost", "activated_unsigned"},
        (Store, "_writable_slot", lambda self: self.state.active or Slot.A),
    ),
    ({"stuck"}, (StoreEcu, "self_test", endless)),
    ({"exceptions"}, (UdsServer, "_read", lambda self, body: 1 // 0)),
)


def test_defects_are_found(monkeypatch):
    for found, *patches in DEFECTS:
        with monkeypatch.context() as patch:
            for owner, name, value in patches:
                patch.setattr(owner, name, value)
            assert violations(fuzz(40_000, seed=3, until=found)) & found, patches
    assert set().union(*(found for found, *_ in DEFECTS)) == set(VIOLATIONS)
