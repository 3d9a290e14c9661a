"""Each step: production, trial, confirmation, the way back, and what damage leaves. Calls in any order and losses of
power are in `tests/proofs/loader_in_c` and `tests/proofs/flash`."""

import pytest

from can_bridge.flashing.backing import RecordKind, Slot, at_once
from can_bridge.flashing.state import TRIAL_BOOTS, SlotPhase, StoreState
from can_bridge.flashing.store import BootReason, OutOfOrderError
from can_bridge.flashing.verdicts import Verdict
from contract.errors import ConfigError, KeyFileError
from contract.release.signing import public_key
from tests.can_bridge.flashing import releases
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import booted, flash, image, keys, name_of, phases, provisioned, transfer

ONE, TWO = image("one"), image("two")


def on_trial(new: bytes = TWO) -> PlainBacking:
    """An ECU with release "one", which boots another one next."""
    backing = provisioned()
    assert flash(booted(backing)[0], new) == Verdict.GOOD
    return backing


def test_an_ecu_leaves_production_with_a_confirmed_release_or_without_one():
    backing = provisioned()
    store, boot = booted(backing)
    assert (boot.slot, boot.reason, boot.verdicts) == (Slot.A, BootReason.CONFIRMED, {Slot.A: Verdict.GOOD})
    assert (name_of(boot), store.last_boot, boot.reason.in_words) == ("one", boot, "confirmed")
    assert store.running == store.state.active == Slot.A
    with pytest.raises(OutOfOrderError, match="must be empty"):
        releases.provision(backing, TWO, keys(2))
    backing = releases.provision(PlainBacking(), None)
    store, boot = booted(backing)
    assert boot.reason == BootReason.NO_RELEASE
    assert flash(store, ONE) == Verdict.GOOD
    store, boot = booted(backing)
    assert (name_of(boot), boot.slot) == ("one", Slot.A)
    # Without a confirmed release a second trial ends the first.
    assert flash(store, TWO) == Verdict.GOOD
    assert phases(store) == [SlotPhase.BAD, SlotPhase.TRIAL]
    with pytest.raises(OutOfOrderError):
        store.confirm()
    assert name_of(booted(backing)[1]) == "two"


def test_nothing_that_would_not_boot_is_put_in_at_production():
    for changes, first, error, message in (
        ({"listed": keys()[:-1]}, ONE, KeyFileError, "key list"),
        ({"root": public_key(releases.STRANGER)}, ONE, KeyFileError, "root key"),
        ({}, image(key=releases.STRANGER), ConfigError, "key that is not in this ECU's list"),
        ({}, image(version=0), ConfigError, "security version"),
        ({"hardware": "x"}, image(hardware="y"), ConfigError, "hardware"),
    ):
        backing = PlainBacking()
        with pytest.raises(error, match=message):
            releases.provision(backing, first, **changes)
        assert booted(backing)[1].reason == BootReason.NO_RELEASE, message
        assert name_of(booted(releases.provision(backing, ONE))[1]) == "one", message


def test_a_flashed_release_is_on_trial_until_it_is_confirmed():
    backing = provisioned()
    store, _ = booted(backing)
    with pytest.raises(OutOfOrderError, match="no release to revert to"):
        at_once(store.revert())
    with pytest.raises(OutOfOrderError, match="transfer and check an image"):
        store.activate()
    transfer(store, TWO)
    with pytest.raises(OutOfOrderError):
        store.activate()
    assert at_once(store.finish()) == Verdict.GOOD
    # A second activation, as if the answer had been lost; then a confirmation of the release that runs.
    for act in (store.activate, store.activate, store.confirm):
        act()
        assert phases(store) == [SlotPhase.CONFIRMED, SlotPhase.TRIAL]
    assert (store.running, store.state.next_boot) == (Slot.A, Slot.B)
    with pytest.raises(OutOfOrderError):
        releases.store_on(backing).confirm()
    store, boot = booted(backing := backing.after_power_on())
    assert (boot.slot, boot.reason, boot.boots_left) == (Slot.B, BootReason.TRIAL, TRIAL_BOOTS - 1)
    with pytest.raises(OutOfOrderError):
        store.activate()
    assert store.state.slots[Slot.B].boots_left == TRIAL_BOOTS - 1
    store.confirm()
    calls = backing.calls
    store.confirm()
    assert phases(store) == [SlotPhase.CONFIRMED, SlotPhase.CONFIRMED]
    assert backing.calls == calls, "confirming twice is confirming once"
    for _ in range(TRIAL_BOOTS + 2):
        _, boot = booted(backing.after_power_on())
        assert (boot.slot, boot.reason) == (Slot.B, BootReason.CONFIRMED)


def test_what_is_not_confirmed_goes_after_three_boots_and_the_image_before_is_back_to_the_bit():
    backing = on_trial(image("two", version=5))
    before, listed = backing.content(Slot.A), backing.kept[RecordKind.KEYS]
    boots = [booted(backing := backing.after_power_on())[1] for _ in range(6)]
    assert [name_of(boot) for boot in boots] == ["two", "two", "two", "one", "one", "one"]
    assert [boot.reason for boot in boots[2:5]] == [BootReason.TRIAL, BootReason.REVERTED, BootReason.CONFIRMED]
    assert [boot.boots_left for boot in boots] == [2, 1, 0, 0, 0, 0]
    assert (backing.content(Slot.A), backing.kept[RecordKind.KEYS]) == (before, listed)
    store, _ = booted(backing)
    assert phases(store) == [SlotPhase.CONFIRMED, SlotPhase.BAD]
    assert store.state.least_security_version == 1
    assert flash(store, TWO) == Verdict.GOOD


def test_a_trial_boot_that_cannot_be_counted_does_not_happen():
    backing = on_trial()
    backing.broken = True
    _, boot = booted(backing)
    assert (name_of(boot), boot.reason) == ("one", BootReason.REVERTED)


def test_the_least_security_version_rises_with_the_confirmation_and_not_before():
    backing = on_trial(image("five", version=5))
    store, _ = booted(backing)
    assert store.state.least_security_version == 1
    store.confirm()
    assert store.state.least_security_version == 5
    assert flash(store, image("four", version=4)) == Verdict.TOO_OLD
    assert flash(store, image("six", version=5)) == Verdict.GOOD
    backing = releases.updated(image("five", version=5), image("again", version=5))
    assert booted(backing)[0].state.least_security_version == 5


def test_one_can_go_back():
    backing = on_trial()
    store, _ = booted(backing)
    assert at_once(store.revert()) == Verdict.GOOD
    assert (name_of(booted(backing)[1]), store.state.on_trial) == ("one", None)
    backing = releases.updated(TWO)
    store, _ = booted(backing)
    for _ in range(2):  # as if the answer had been lost
        assert at_once(store.revert()) == Verdict.GOOD
    store, boot = booted(backing)
    assert (name_of(boot), boot.reason) == ("one", BootReason.CONFIRMED)
    assert at_once(store.revert()) == Verdict.GOOD
    assert name_of(booted(backing)[1]) == "two"
    releases.damage(backing, Slot.A)
    assert at_once(booted(backing)[0].revert()) == Verdict.WRONG_HASH
    # A release that has become too old is no way back.
    backing = releases.updated(image("five", version=5))
    assert at_once(booted(backing)[0].revert()) == Verdict.TOO_OLD
    releases.damage(backing, Slot.B)
    assert booted(backing)[1].verdicts == {Slot.A: Verdict.TOO_OLD, Slot.B: Verdict.WRONG_HASH}


def test_a_damaged_image_is_given_up_for_the_one_before():
    backing = on_trial()
    releases.damage(backing, Slot.B)
    store, boot = booted(backing)
    assert (name_of(boot), boot.reason) == ("one", BootReason.REVERTED)
    assert boot.verdicts == {Slot.A: Verdict.GOOD, Slot.B: Verdict.WRONG_HASH}
    assert phases(store) == [SlotPhase.CONFIRMED, SlotPhase.BAD]
    backing = releases.updated(TWO)
    releases.damage(backing, Slot.B)
    store, boot = booted(backing)
    assert (name_of(boot), boot.reason, boot.verdicts[Slot.B]) == ("one", BootReason.FALLBACK, Verdict.WRONG_HASH)
    before = backing.content(Slot.A)
    assert transfer(store, TWO) == 0  # the same image, but what stands there is known to be bad
    assert at_once(store.finish()) == Verdict.GOOD
    store.activate()
    assert backing.content(Slot.A) == before
    assert name_of(booted(backing)[1]) == "two"
    # Without any slot in order the ECU can be flashed.
    backing.slots = dict.fromkeys(Slot)
    store, boot = booted(backing)
    assert (boot.slot, boot.bundle, boot.reason) == (None, None, BootReason.NO_RELEASE)
    assert set(boot.verdicts.values()) == {Verdict.UNREADABLE}
    assert flash(store, image("three")) == Verdict.GOOD
    assert name_of(booted(backing)[1]) == "three"
    # A refused release stays confirmed and is judged again: the ECU was given another vehicle by mistake.
    backing = provisioned()
    boot = releases.store_on(backing, fits=lambda bundle: Verdict.WRONG_VEHICLE).boot()
    assert (boot.reason, boot.verdicts) == (BootReason.NO_RELEASE, {Slot.A: Verdict.WRONG_VEHICLE})
    assert booted(backing)[1].reason == BootReason.CONFIRMED


def test_damaged_or_missing_records_are_an_empty_store():
    for kind in (None, *RecordKind):
        for record in (b"", b"rubbish", b"\xff" * 300):
            backing = provisioned()
            backing.kept = {} if kind is None else {**backing.kept, kind: record}
            store, boot = booted(backing)
            needed = kind not in (RecordKind.CALIBRATION, RecordKind.FAULTS)
            assert not needed or boot.reason == BootReason.NO_RELEASE, (kind, record)
            if kind in (None, RecordKind.STATE):
                assert store.state == StoreState()
            if kind in (None, RecordKind.KEYS):
                store.take_keys(keys())
            assert flash(store, TWO) == Verdict.GOOD
            assert name_of(booted(backing)[1]) == "two", (kind, record)
    # A state with an image that no slot holds.
    backing = provisioned()
    backing.capacity = 1000
    assert releases.store_on(backing).state == StoreState()
