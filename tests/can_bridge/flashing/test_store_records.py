"""An image on its way into a slot; key lists, calibrations and failed attempts."""

import hashlib
from unittest.mock import Mock

import pytest

from can_bridge.flashing import remembered
from can_bridge.flashing.backing import MAX_RECORD, MediumError, Slot, at_once
from can_bridge.flashing.state import Level, SlotPhase
from can_bridge.flashing.store import OutOfOrderError, Store
from can_bridge.flashing.verdicts import Verdict
from contract.errors import ConfigError, KeyFileError
from contract.release.signing import public_key
from tests.can_bridge.flashing import releases
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import RELEASE, SECOND, booted, flash, image, keys, provisioned, transfer

ONE, TWO = image("one"), image("two")
SHA256 = hashlib.sha256(TWO).digest()


def test_an_interrupted_transfer_goes_on_where_it_ended():
    backing = provisioned()
    transfer(booted(backing)[0], TWO, until=2 * releases.BLOCK)
    store, _ = booted(backing.after_power_on())
    assert transfer(store, TWO) == 2 * releases.BLOCK
    # In another session, too; and what is whole needs no byte again, checked or not.
    for _ in range(2):
        store.drop()
        assert (store.received, transfer(store, TWO)) == (None, len(TWO))
        assert [at_once(store.finish()) for _ in range(2)] == [Verdict.GOOD, Verdict.GOOD]


def test_what_cannot_be_gone_on_with_begins_at_the_start(monkeypatch):
    def begun() -> PlainBacking:
        backing = provisioned()
        transfer(booted(backing)[0], TWO, until=2 * releases.BLOCK)
        return backing.after_power_on()

    for length, sha256 in ((len(TWO) - 1, SHA256), (len(TWO), hashlib.sha256(ONE).digest())):
        backing = begun()
        store, _ = booted(backing)
        assert at_once(store.announce(length, sha256)) == 0, length
        assert backing.content(Slot.B) == b""
    # One that failed a check.
    wrong = image(key=releases.STRANGER)
    assert flash(store, wrong) == Verdict.UNKNOWN_KEY
    assert releases.phases(store) == [SlotPhase.CONFIRMED, SlotPhase.BAD]
    assert transfer(store, wrong) == 0
    # An announcement that ends halfway.
    next(store.announce(len(ONE), hashlib.sha256(ONE).digest()))
    assert store.received is None
    assert releases.phases(booted(backing.after_power_on())[0]) == [SlotPhase.CONFIRMED, SlotPhase.EMPTY]

    monkeypatch.setattr(PlainBacking, "begin_again", Mock(side_effect=MediumError("worn out")))
    store, _ = booted(begun())
    assert transfer(store, TWO) == 0
    assert at_once(store.finish()) == Verdict.GOOD


def test_what_arrives_must_be_what_was_announced():
    backing = provisioned()
    store, _ = booted(backing)
    calls = backing.calls
    for length, sha256 in ((0, bytes(32)), (200_001, bytes(32)), (5, bytes(31)), (-1, bytes(32))):
        with pytest.raises(ConfigError, match="must have"):
            at_once(store.announce(length, sha256))
    for act in (lambda: store.append(b"x"), lambda: at_once(store.finish())):
        with pytest.raises(OutOfOrderError, match="announce an image first"):
            act()
    assert backing.calls == calls
    at_once(store.announce(len(TWO), SHA256))
    store.append(TWO[:-1])
    assert at_once(store.finish()) == Verdict.INCOMPLETE
    assert releases.phases(store) == [SlotPhase.CONFIRMED, SlotPhase.FILLING]
    store.append(b"\0" if TWO[-1] else b"\1")
    with pytest.raises(OutOfOrderError, match="more bytes are too many"):
        store.append(b"x")
    assert at_once(store.finish()) == Verdict.WRONG_HASH
    with pytest.raises(OutOfOrderError):
        store.activate()


def test_nothing_is_written_between_going_back_and_the_reset():
    """One release runs, and the other one boots next: neither slot is free."""
    backing = releases.updated(TWO)
    store, _ = booted(backing)
    at_once(store.revert())
    before = [backing.content(slot) for slot in Slot]
    with pytest.raises(OutOfOrderError, match="reset the ECU first"):
        transfer(store, image("three"))
    assert [backing.content(slot) for slot in Slot] == before
    store, boot = booted(backing)
    assert (releases.name_of(boot), flash(store, image("three"))) == ("one", Verdict.GOOD)
    assert backing.content(Slot.A) == before[Slot.A]


def trying_a_second_key(version: int = 1) -> tuple[PlainBacking, Store]:
    """An ECU with key list 2, and a release by the second key on trial."""
    backing = provisioned()
    store, _ = booted(backing)
    store.take_keys(keys(2, RELEASE, SECOND))
    assert flash(store, image("two", key=SECOND, version=version)) == Verdict.GOOD
    return backing, booted(backing)[0]


def test_only_a_newer_list_by_the_root_key_is_taken():
    """An older one was signed by the root key, too; whoever brings it again would bring a revoked key back."""
    backing = provisioned()
    store, _ = booted(backing)
    store.take_keys(keys(3, RELEASE, revoked=(SECOND,)))
    for version in (1, 2, 3):
        with pytest.raises(KeyFileError, match=f"version {version} must be greater than 3, this ECU's version"):
            store.take_keys(keys(version, RELEASE, SECOND))
    assert flash(booted(backing)[0], image(key=SECOND)) == Verdict.REVOKED_KEY
    other = releases.store_on(backing, root=public_key(releases.STRANGER))
    assert other.keys is None
    with pytest.raises(KeyFileError, match="must be by the root key"):
        other.take_keys(keys(4))


def test_a_key_list_must_keep_the_keys_of_the_confirmed_release_and_of_the_one_that_runs():
    backing, store = trying_a_second_key()
    with pytest.raises(KeyFileError, match="which signed the confirmed release"):  # it is the way back of the trial
        store.take_keys(keys(3, SECOND, revoked=(RELEASE,)))
    store.confirm()
    store.take_keys(keys(3, SECOND, revoked=(RELEASE,)))
    store, boot = booted(backing)
    assert (releases.name_of(boot), at_once(store.revert())) == ("two", Verdict.REVOKED_KEY)
    backing, store = trying_a_second_key()
    store.confirm()
    releases.damage(backing, Slot.B)
    store, _ = booted(backing)
    with pytest.raises(KeyFileError, match=f"lacks key {public_key(RELEASE).fingerprint}"):
        store.take_keys(keys(3, SECOND))
    assert releases.name_of(booted(backing)[1]) == "one"


def test_a_trial_whose_key_is_revoked_is_not_confirmed_and_ends():
    """It would not boot again, and the release before it would be too old."""
    backing, store = trying_a_second_key(version=2)
    store.take_keys(keys(3, RELEASE, revoked=(SECOND,)))
    with pytest.raises(OutOfOrderError, match="is not in the list"):
        store.confirm()
    _, boot = booted(backing)
    assert (releases.name_of(boot), boot.verdicts[Slot.B]) == ("one", Verdict.REVOKED_KEY)


def test_a_calibration_belongs_to_one_release_and_goes_with_it():
    backing = provisioned()
    with pytest.raises(OutOfOrderError, match="a release must run"):
        releases.store_on(backing).keep_calibration(b"x")
    store, boot = booted(backing)
    with pytest.raises(ConfigError, match="1025 bytes"):
        store.keep_calibration(b"x" * 1025)
    one = releases.digest_of(boot)
    store.keep_calibration(b"of one")
    flash(store, TWO)
    store, boot = booted(backing)
    assert (store.calibration(one), store.calibration(releases.digest_of(boot))) == (b"of one", None)
    store.keep_calibration(b"of two")
    assert at_once(store.revert()) == Verdict.GOOD
    store, boot = booted(backing)
    assert (releases.digest_of(boot), store.calibration(one)) == (one, b"of one")
    store.keep_calibration(None)
    assert booted(backing)[0].calibration(one) is None
    store.keep_calibration(b"x" * 1024)
    for name in "abc":
        flash(store, image(name))
        store, boot = booted(backing)
        store.confirm()
        store.keep_calibration(b"y" * 1024)
        assert store.calibration(releases.digest_of(boot)) == b"y" * 1024, name
    assert store.calibration(one) is None


def test_failed_attempts_and_faults_outlive_a_reset():
    backing = provisioned()
    store, _ = booted(backing)
    store.keep_failed_attempts(Level.PROGRAMMING, 2)
    store.keep_failed_attempts(Level.CALIBRATION, 400)
    store.keep_faults(b"faults")
    calls = backing.calls
    store.keep_failed_attempts(Level.PROGRAMMING, 2)
    assert backing.calls == calls, "the memory wears out by writing what is there"
    store = releases.store_on(backing.after_power_on())
    for _ in range(2):
        assert (store.state.failed_attempts, store.faults) == (dict(zip(Level, (2, 255), strict=True)), b"faults")
        store.boot()
        flash(store, TWO)


def test_a_record_of_calibrations_comes_back_and_what_is_no_record_is_refused():
    for kept in ({}, {"ab" * 32: bytes(1024), "cd" * 32: bytes(range(256)) * 4}):
        raw = remembered.encode_calibrations(kept)
        assert (remembered.decode_calibrations(raw), len(raw) <= MAX_RECORD) == (kept, True)
    raw = remembered.encode_calibrations({"ab" * 32: b"one", "cd" * 32: b"two"})
    assert raw == b"SWC1\2" + b"\xab" * 32 + b"\0\3one" + b"\xcd" * 32 + b"\0\3two"
    cut = (raw[:length] for length in range(len(raw)))
    one, two = raw[5:42], raw[42:]
    odd = (raw[:5] + two + one, raw[:5] + one + one, b"SWC1\1" + one[:32] + bytes(2))
    too_long = b"SWC1\1" + raw[5:37] + b"\4\1" + bytes(1025)
    for wrong in (*cut, raw + b"\0", b"SWC2" + raw[4:], b"SWC1\3" + raw[5:], too_long, *odd):
        with pytest.raises(ValueError):  # whatever is wrong with it, nothing was kept
            remembered.decode_calibrations(wrong)
