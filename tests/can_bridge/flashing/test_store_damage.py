"""Damaged images and records."""

import pytest

from can_bridge.flashing.backing import Kind, Slot, at_once
from can_bridge.flashing.boot import BootReason
from can_bridge.flashing.state import StoreState
from can_bridge.flashing.store import Store
from can_bridge.flashing.verdicts import Verdict
from contract.release.signing import public_key
from tests.can_bridge.flashing.releases import (
    HARDWARE,
    ROOT,
    booted,
    damage,
    flash,
    image,
    keys,
    name_of,
    provisioned,
    transfer,
    updated,
)

ONE, TWO = image("one"), image("two")


def test_when_the_confirmed_release_is_damaged_the_one_before_boots():
    backing = updated(TWO)
    damage(backing, Slot.B)
    store, boot = booted(backing)
    assert (name_of(boot), boot.reason, boot.verdicts[Slot.B]) == ("one", BootReason.FALLBACK, Verdict.WRONG_HASH)
    before = backing.content(Slot.A)
    assert transfer(store, TWO) == 0  # the same image, but what stands there is known to be bad
    assert at_once(store.finish()) == Verdict.GOOD
    store.activate()
    assert backing.content(Slot.A) == before
    assert name_of(booted(backing)[1]) == "two"


def test_a_refused_release_stays_confirmed_and_is_judged_anew():
    """Another vehicle, or another stillwake.dbc, given to the ECU by mistake."""
    backing = provisioned()
    mistaken = Store(backing, root=public_key(ROOT), hardware=HARDWARE, fits=lambda bundle: Verdict.WRONG_VEHICLE)
    boot = mistaken.boot()
    assert (boot.reason, boot.verdicts) == (BootReason.NO_RELEASE, {Slot.A: Verdict.WRONG_VEHICLE})
    assert name_of(booted(backing)[1]) == "one"


@pytest.mark.parametrize("images", [(), (TWO,)])
def test_with_no_slot_in_order_there_is_no_bundle_and_the_ecu_can_be_flashed(images):
    backing = updated(*images)
    for slot in Slot:
        backing.memory.slots[slot] = None
    store, boot = booted(backing)
    assert (boot.slot, boot.bundle, boot.reason) == (None, None, BootReason.NO_RELEASE)
    assert set(boot.verdicts.values()) == {Verdict.UNREADABLE}
    assert flash(store, image("three")) == Verdict.GOOD
    store, boot = booted(backing)
    assert (name_of(boot), boot.reason) == ("three", BootReason.TRIAL)
    store.confirm()
    assert name_of(booted(backing)[1]) == "three"


@pytest.mark.parametrize("record", [b"", b"rubbish", b"\xff" * 300])
@pytest.mark.parametrize("kind", [None, *Kind])
def test_damaged_or_missing_records_are_an_empty_store(kind, record):
    backing = provisioned()
    if kind is None:
        backing.memory.records.clear()
    else:
        backing.memory.records[kind] = record
    store, boot = booted(backing)
    if kind != Kind.CALIBRATION:
        assert boot.reason == BootReason.NO_RELEASE
    if kind in (None, Kind.STATE):
        assert store.state == StoreState()
    if kind in (None, Kind.KEYS):
        store.take_keys(keys())
    assert flash(store, TWO) == Verdict.GOOD
    assert name_of(booted(backing)[1]) == "two"
