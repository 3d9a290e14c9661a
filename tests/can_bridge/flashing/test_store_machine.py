"""Whatever a tester does, in whatever order: with a sound memory, an ECU that had a release always has one."""

import hashlib

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from can_bridge.flashing import checking, remembered, state
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Kind, at_once
from can_bridge.flashing.medium import PowerCut
from can_bridge.flashing.state import TRIAL_BOOTS, Phase
from can_bridge.flashing.store import OutOfOrderError
from can_bridge.flashing.verdicts import Verdict
from contract.errors import KeyFileError
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import (
    RELEASE,
    SECOND,
    STRANGER,
    booted,
    digest_of,
    flash,
    image,
    keys,
    provisioned,
)
from tests.examples import examples

SIGNERS = (RELEASE, SECOND, STRANGER)
VERSIONS = st.integers(1, 3)
AT = st.integers(0, 2)
"""Of who signed a release."""
LISTS = ((RELEASE,), (SECOND,), (RELEASE, SECOND))
"""Of the keys that may sign."""
CHECKED: dict[object, object] = {}


def check(raw: bytes, rules: checking.Rules) -> object:
    """As `checking.check`, which depends on nothing but its arguments; each is judged once."""
    key = raw, rules.keys, rules.least_security_version
    if key not in CHECKED:
        CHECKED[key] = checking.check(raw, rules)
    return CHECKED[key]


def offered(version: int, at: int) -> bytes:
    return image(f"{version}-{at}", key=SIGNERS[at], version=version)


class AnyTester(RuleBasedStateMachine):
    """Model: which releases were confirmed, and which security version was the greatest of them."""

    @initialize()
    def leave_production(self) -> None:
        self.backing: PlainBacking = provisioned()
        self.list_version = 1
        self.least = 1
        self.boots_of_trial = 0
        self.announced = 0
        self.power_on()

    def power_on(self) -> None:
        before = {slot: bytes(content or b"") for slot, content in self.backing.memory.slots.items()}
        self.store, self.boot = booted(self.backing)
        assert self.boot.bundle is not None, "no release"
        assert self.boot.slot is not None
        self.protected = self.boot.slot, before[self.boot.slot]
        signer = self.boot.bundle.signer
        assert signer is not None
        assert self.store.keys is not None
        assert signer in self.store.keys.keys
        assert self.boot.bundle.manifest.security_version >= self.least
        is_trial = self.store.state.slots[self.boot.slot].phase == Phase.TRIAL
        self.boots_of_trial = self.boots_of_trial + 1 if is_trial else 0
        assert self.boots_of_trial <= TRIAL_BOOTS

    @rule(seed=st.integers(0, 99))
    def reset(self, seed: int) -> None:
        self.backing = self.backing.after_power_on(seed=seed)
        self.power_on()

    @rule(version=VERSIONS, at=AT, blocks=st.integers(0, 6), cut=st.none() | st.integers(0, 12))
    def transfer(self, version: int, at: int, blocks: int, cut: int | None) -> None:
        new = offered(version, at)
        self.backing._cut_at = None if cut is None else self.backing.calls + cut
        try:
            self.announced = len(new)
            wanted = at_once(self.store.announce(len(new), hashlib.sha256(new).digest()))
            for start in range(wanted, min(len(new), wanted + blocks * 6_000), 6_000):
                self.store.append(new[start : start + 6_000])
        except OutOfOrderError:
            pass
        except PowerCut:
            self.reset(cut or 0)
        finally:
            self.backing._cut_at = None

    @rule()
    def finish(self) -> None:
        try:
            verdict = at_once(self.store.finish())
        except OutOfOrderError:
            return
        if self.store.received == self.announced:
            assert verdict != Verdict.INCOMPLETE
        assert (verdict == Verdict.GOOD) == (self.store.state.checked is not None)

    @rule(version=VERSIONS, at=AT)
    def flash(self, version: int, at: int) -> None:
        try:
            verdict = flash(self.store, offered(version, at))
        except OutOfOrderError:
            return
        if verdict == Verdict.GOOD:
            self.boots_of_trial = 0
            self.reset(0)

    @rule()
    def activate(self) -> None:
        fresh = self.store.state.checked is not None
        try:
            self.store.activate()
        except OutOfOrderError:
            assert not fresh
        if fresh:
            self.boots_of_trial = 0

    @rule()
    def confirm(self) -> None:
        try:
            self.store.confirm()
        except OutOfOrderError:
            return
        assert self.boot.bundle is not None
        assert self.store.running is not None
        assert self.store.state.slots[self.store.running].digest == digest_of(self.boot)
        self.least = max(self.least, self.boot.bundle.manifest.security_version)

    @rule()
    def revert(self) -> None:
        try:
            at_once(self.store.revert())
        except OutOfOrderError:
            assert self.store.state.on_trial is None

    @rule(at=st.integers(0, 2), newer=st.sampled_from([1, 1, 1, 0, -1]))
    def take_keys(self, at: int, newer: int) -> None:
        version = max(1, self.list_version + newer)
        try:
            self.store.take_keys(keys(version, *LISTS[at]))
        except KeyFileError:
            return
        assert version > self.list_version
        self.list_version = version

    @rule(count=st.integers(0, 3))
    def count_attempts(self, count: int) -> None:
        self.store.keep_failed_attempts(Level.PROGRAMMING, count)
        if self.store.running is not None:
            self.store.keep_calibration(bytes([count]))

    @invariant()
    def what_is_kept_is_what_is_there(self) -> None:
        if hasattr(self, "store"):
            assert state.decode(self.backing.memory.records.get(Kind.STATE, b"")) == self.store.state
            assert self.store.state.least_security_version == self.least
            assert self.store.keys is not None
            assert self.store.keys.version == self.list_version

    @invariant()
    def a_confirmed_release_that_runs_is_not_written(self) -> None:
        if hasattr(self, "store") and self.store.running is not None:
            slot, content = self.protected
            if self.store.state.slots[slot].phase == Phase.CONFIRMED:
                assert self.backing.content(slot) == content


@pytest.mark.slow
def test_whatever_a_tester_does_the_ecu_has_a_release(monkeypatch):
    monkeypatch.setattr(remembered, "check", check)
    run_state_machine_as_test(AnyTester, settings=examples(60, stateful_step_count=30, deadline=None))
