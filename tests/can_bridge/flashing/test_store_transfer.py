"""An image on its way into a slot."""

import hashlib

import pytest

from can_bridge.flashing.backing import Slot, at_once
from can_bridge.flashing.medium import MediumError
from can_bridge.flashing.state import Phase
from can_bridge.flashing.store import OutOfOrderError
from can_bridge.flashing.verdicts import Verdict
from contract.errors import ConfigError
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import (
    BLOCK,
    STRANGER,
    booted,
    flash,
    image,
    name_of,
    phases,
    provisioned,
    transfer,
    updated,
)

ONE, TWO = image("one"), image("two")
SHA256 = hashlib.sha256(TWO).digest()


def test_an_interrupted_transfer_goes_on_where_it_ended():
    backing = provisioned()
    store, _ = booted(backing)
    transfer(store, TWO, until=2 * BLOCK)
    assert store.received == 2 * BLOCK
    backing = backing.after_power_on()
    store, _ = booted(backing)
    assert transfer(store, TWO) == 2 * BLOCK
    # In another session too; and what is whole needs no byte again, checked or not.
    for _ in range(2):
        store.drop()
        assert store.received is None
        assert transfer(store, TWO) == len(TWO)
        for _ in range(2):
            assert at_once(store.finish()) == Verdict.GOOD


def test_what_cannot_be_gone_on_with_begins_at_the_start(monkeypatch):
    def begun() -> PlainBacking:
        backing = provisioned()
        transfer(booted(backing)[0], TWO, until=2 * BLOCK)
        return backing.after_power_on()

    for length, sha256 in ((len(TWO) - 1, SHA256), (len(TWO), hashlib.sha256(ONE).digest())):
        backing = begun()
        store, _ = booted(backing)
        assert at_once(store.announce(length, sha256)) == 0, length
        assert backing.content(Slot.B) == b""
    # One that failed a check.
    wrong = image(key=STRANGER)
    assert flash(store, wrong) == Verdict.UNKNOWN_KEY
    assert phases(store) == [Phase.CONFIRMED, Phase.BAD]
    assert transfer(store, wrong) == 0

    def fails(self: PlainBacking, slot: Slot, length: int) -> None:
        raise MediumError("worn out", length)

    monkeypatch.setattr(PlainBacking, "begin_again", fails)
    store, _ = booted(begun())
    assert transfer(store, TWO) == 0
    assert at_once(store.finish()) == Verdict.GOOD


def test_an_image_is_not_checked_before_it_is_whole():
    store, _ = booted(provisioned())
    transfer(store, TWO, until=BLOCK)
    assert at_once(store.finish()) == Verdict.INCOMPLETE
    assert phases(store) == [Phase.CONFIRMED, Phase.FILLING]


def test_what_arrives_must_be_what_was_announced():
    store, _ = booted(provisioned())
    with pytest.raises(OutOfOrderError, match="announce it first"):
        store.append(b"x")
    with pytest.raises(OutOfOrderError, match="announce it first"):
        at_once(store.finish())
    at_once(store.announce(len(TWO), SHA256))
    store.append(TWO[:-1])
    store.append(b"\0" if TWO[-1] else b"\1")
    with pytest.raises(OutOfOrderError, match="must end at the announced"):
        store.append(b"x")
    assert at_once(store.finish()) == Verdict.WRONG_HASH
    with pytest.raises(OutOfOrderError):
        store.activate()


def test_what_cannot_be_an_image_is_not_announced():
    backing = provisioned()
    store, _ = booted(backing)
    calls = backing.calls
    for length, sha256 in ((0, bytes(32)), (200_001, bytes(32)), (5, bytes(31)), (-1, bytes(32))):
        with pytest.raises(ConfigError, match="must have"):
            at_once(store.announce(length, sha256))
    assert backing.calls == calls


def test_an_announcement_that_ends_halfway_is_no_transfer():
    backing = provisioned()
    store, _ = booted(backing)
    transfer(store, TWO)
    next(store.announce(len(ONE), hashlib.sha256(ONE).digest()))
    assert store.received is None
    store, _ = booted(backing.after_power_on())
    assert phases(store) == [Phase.CONFIRMED, Phase.EMPTY]
    assert flash(store, TWO) == Verdict.GOOD


def test_the_running_confirmed_image_is_never_written():
    for images in ((), (TWO,), (TWO, ONE)):
        backing = updated(*images)
        store, boot = booted(backing)
        before = backing.content(boot.slot)
        for name in "abc":
            transfer(store, image(name), until=BLOCK)
            assert backing.content(boot.slot) == before, (len(images), name)


def test_nothing_is_written_between_going_back_and_the_reset():
    """One release runs, and the other one boots next: neither slot is free."""
    backing = updated(TWO)
    store, _ = booted(backing)
    at_once(store.revert())
    before = {slot: backing.content(slot) for slot in Slot}
    with pytest.raises(OutOfOrderError, match="reset the ECU first"):
        transfer(store, image("three"))
    assert {slot: backing.content(slot) for slot in Slot} == before
    store, boot = booted(backing)
    assert name_of(boot) == "one"
    assert flash(store, image("three")) == Verdict.GOOD
    assert backing.content(Slot.A) == before[Slot.A]
