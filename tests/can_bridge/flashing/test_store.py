"""The store's rules, one by one."""

import hashlib

import pytest

from can_bridge.flashing.backing import Kind, Slot, at_once
from can_bridge.flashing.boot import BootReason
from can_bridge.flashing.state import TRIAL_BOOTS, Phase, StoreState
from can_bridge.flashing.store import OutOfOrderError, Store
from can_bridge.flashing.verdicts import Verdict
from can_bridge.uds.services import Level
from contract.errors import ConfigError, KeyFileError
from contract.release.signing import public_key
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import (
    BLOCK,
    HARDWARE,
    RELEASE,
    ROOT,
    SECOND,
    STRANGER,
    booted,
    fits,
    flash,
    image,
    keys,
    provisioned,
    store_on,
    transfer,
)

ONE, TWO = image("one"), image("two")


def phases(store: Store) -> list[Phase]:
    return [slot.phase for slot in store.state.slots]


def name_of(boot) -> str | None:
    return None if boot.bundle is None else boot.bundle.manifest.name


def updated(*images: bytes) -> PlainBacking:
    """An ECU on which release "one" and then all these were confirmed."""
    backing = provisioned()
    for new in images:
        store, _ = booted(backing)
        assert flash(store, new) == Verdict.GOOD
        backing = backing.after_power_on()
        store, _ = booted(backing)
        store.confirm()
        backing = backing.after_power_on()
    return backing


def damage(backing: PlainBacking, slot: Slot, at: int = 30_000) -> None:
    backing.memory.slots[slot][at] ^= 1


# Production.


def test_an_ecu_leaves_production_with_a_confirmed_release():
    store, boot = booted(provisioned())
    assert (boot.slot, boot.reason, boot.verdicts) == (Slot.A, BootReason.CONFIRMED, {Slot.A: Verdict.GOOD})
    assert name_of(boot) == "one"
    assert store.state.least_security_version == 1
    assert store.running == store.state.active == Slot.A


def test_an_ecu_may_leave_production_without_a_release():
    backing = PlainBacking()
    Store.provision(backing, root=public_key(ROOT), keys=keys(), image=None, hardware=HARDWARE, fits=fits)
    store, boot = booted(backing)
    assert boot.reason == BootReason.NO_RELEASE
    assert flash(store, ONE) == Verdict.GOOD
    assert name_of(booted(backing)[1]) == "one"


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"keys": keys()[:-1]}, KeyFileError, "key list"),
        ({"root": public_key(STRANGER)}, KeyFileError, "root key"),
        ({"image": image(key=STRANGER)}, ConfigError, "key that this ECU does not know"),
        ({"image": image(version=0)}, ConfigError, "security version"),
        ({"hardware": "x", "image": image(hardware="y")}, ConfigError, "hardware"),
    ],
)
def test_nothing_that_would_not_boot_is_put_in_at_production(changes, error, message):
    backing = PlainBacking()
    arguments = {"root": public_key(ROOT), "keys": keys(), "image": ONE, "hardware": HARDWARE, "fits": fits}
    with pytest.raises(error, match=message):
        Store.provision(backing, **{**arguments, **changes})
    assert booted(backing)[1].reason == BootReason.NO_RELEASE


def test_a_provisioned_ecu_is_not_provisioned_again():
    with pytest.raises(OutOfOrderError, match="must be empty"):
        Store.provision(
            provisioned(), root=public_key(ROOT), keys=keys(2), image=TWO, hardware=HARDWARE, fits=fits
        )  # fmt: skip


# Trial.


def test_a_flashed_release_is_on_trial_until_it_is_confirmed():
    backing = provisioned()
    store, _ = booted(backing)
    assert flash(store, TWO) == Verdict.GOOD
    assert phases(store) == [Phase.CONFIRMED, Phase.TRIAL]
    assert (store.running, store.state.next_boot) == (Slot.A, Slot.B)
    store, boot = booted(backing.after_power_on())
    assert (boot.slot, boot.reason, boot.boots_left) == (Slot.B, BootReason.TRIAL, TRIAL_BOOTS - 1)
    store.confirm()
    assert phases(store) == [Phase.CONFIRMED, Phase.CONFIRMED]
    for _ in range(TRIAL_BOOTS + 2):
        _, boot = booted(backing.after_power_on())
        assert (boot.slot, boot.reason) == (Slot.B, BootReason.CONFIRMED)


def test_what_nobody_confirms_goes_after_three_boots_and_the_image_before_is_back_to_the_bit():
    backing = provisioned()
    before, records = bytes(backing.memory.slots[Slot.A]), dict(backing.memory.records)
    store, _ = booted(backing)
    flash(store, TWO)
    found = [booted(backing := backing.after_power_on())[1] for _ in range(6)]
    assert [name_of(boot) for boot in found] == ["two", "two", "two", "one", "one", "one"]
    assert [boot.reason for boot in found[2:5]] == [BootReason.TRIAL, BootReason.REVERTED, BootReason.CONFIRMED]
    assert [boot.boots_left for boot in found] == [2, 1, 0, 0, 0, 0]
    assert backing.memory.slots[Slot.A] == before
    assert backing.memory.records[Kind.KEYS] == records[Kind.KEYS]
    assert phases(store_on(backing)) == [Phase.CONFIRMED, Phase.BAD]


def test_a_trial_boot_is_counted_before_it():
    """A release that takes the ECU down with it, before anything else is kept, ends its trial all the same."""
    backing = provisioned()
    flash(booted(backing)[0], TWO)
    for left in (2, 1, 0):
        store_on(backing).boot()
        assert store_on(backing).state.slots[Slot.B].boots_left == left


def test_a_trial_that_cannot_be_counted_does_not_run():
    backing = provisioned()
    flash(booted(backing)[0], TWO)
    backing.broken = True
    _, boot = booted(backing)
    assert (name_of(boot), boot.reason) == ("one", BootReason.REVERTED)


def test_a_trial_image_that_is_damaged_is_given_up_at_once():
    backing = provisioned()
    flash(booted(backing)[0], TWO)
    damage(backing, Slot.B)
    store, boot = booted(backing)
    assert (name_of(boot), boot.reason) == ("one", BootReason.REVERTED)
    assert boot.verdicts == {Slot.A: Verdict.GOOD, Slot.B: Verdict.WRONG_HASH}
    assert phases(store) == [Phase.CONFIRMED, Phase.BAD]


def test_during_a_trial_another_image_takes_its_place_and_the_confirmed_one_stays():
    backing = provisioned()
    flash(booted(backing)[0], TWO)
    store, _ = booted(backing)
    before = bytes(backing.memory.slots[Slot.A])
    transfer(store, image("three"), until=BLOCK)
    with pytest.raises(OutOfOrderError, match="no release to confirm"):
        store.confirm()
    assert flash(store, image("three")) == Verdict.GOOD
    with pytest.raises(OutOfOrderError, match="no release to confirm"):  # it is activated, and has not run
        store.confirm()
    assert backing.memory.slots[Slot.A] == before
    assert name_of(booted(backing)[1]) == "three"


def test_confirming_twice_is_confirming_once():
    backing = provisioned()
    flash(booted(backing)[0], TWO)
    store, _ = booted(backing)
    store.confirm()
    calls = backing.calls
    store.confirm()
    assert backing.calls == calls


def test_only_what_runs_can_be_confirmed():
    backing = provisioned()
    store = store_on(backing)
    with pytest.raises(OutOfOrderError):
        store.confirm()
    store.boot()
    flash(store, TWO)
    store.confirm()  # of the release that runs, which is confirmed
    assert phases(store) == [Phase.CONFIRMED, Phase.TRIAL]


def test_only_a_checked_image_can_be_activated():
    store, _ = booted(provisioned())
    with pytest.raises(OutOfOrderError, match="must be transferred and checked"):
        store.activate()
    transfer(store, TWO)
    with pytest.raises(OutOfOrderError):
        store.activate()
    at_once(store.finish())
    store.activate()
    store.activate()  # as if the answer had been lost
    assert phases(store) == [Phase.CONFIRMED, Phase.TRIAL]
    assert store.state.slots[Slot.B].boots_left == TRIAL_BOOTS


def test_a_trial_that_runs_is_not_activated_anew():
    backing = provisioned()
    flash(booted(backing)[0], TWO)
    store, _ = booted(backing)
    with pytest.raises(OutOfOrderError):
        store.activate()
    assert store.state.slots[Slot.B].boots_left == TRIAL_BOOTS - 1


# Downgrade.


def test_the_least_security_version_rises_with_the_confirmation_and_not_before():
    backing = provisioned()
    store, _ = booted(backing)
    flash(store, image("five", version=5))
    assert store.state.least_security_version == 1
    store, _ = booted(backing)
    assert store.state.least_security_version == 1
    store.confirm()
    assert store.state.least_security_version == 5
    assert flash(store, image("four", version=4)) == Verdict.TOO_OLD
    assert flash(store, image("six", version=5)) == Verdict.GOOD


def test_a_trial_that_is_given_up_leaves_the_least_security_version():
    backing = provisioned()
    flash(booted(backing)[0], image("five", version=5))
    for _ in range(TRIAL_BOOTS + 1):
        store, _ = booted(backing)
    assert store.state.least_security_version == 1
    assert flash(store, image("two", version=1)) == Verdict.GOOD


def test_the_least_security_version_never_falls():
    store, _ = booted(updated(image("five", version=5), image("again", version=5)))
    assert store.state.least_security_version == 5


def test_a_release_that_has_become_too_old_is_no_way_back():
    backing = updated(image("five", version=5))
    store, _ = booted(backing)
    assert at_once(store.revert()) == Verdict.TOO_OLD
    damage(backing, Slot.B)
    _, boot = booted(backing)
    assert boot.reason == BootReason.NO_RELEASE
    assert boot.verdicts == {Slot.A: Verdict.TOO_OLD, Slot.B: Verdict.WRONG_HASH}


# Going back.


def test_a_trial_can_be_given_up():
    backing = provisioned()
    flash(booted(backing)[0], TWO)
    store, _ = booted(backing)
    assert at_once(store.revert()) == Verdict.GOOD
    assert (name_of(booted(backing)[1]), store.state.on_trial) == ("one", None)


def test_the_release_before_can_be_gone_back_to():
    backing = updated(TWO)
    store, _ = booted(backing)
    assert at_once(store.revert()) == Verdict.GOOD
    assert at_once(store.revert()) == Verdict.GOOD  # as if the answer had been lost
    store, boot = booted(backing)
    assert (name_of(boot), boot.reason) == ("one", BootReason.CONFIRMED)
    assert at_once(store.revert()) == Verdict.GOOD
    assert name_of(booted(backing)[1]) == "two"


def test_without_a_release_before_there_is_no_way_back():
    store, _ = booted(provisioned())
    with pytest.raises(OutOfOrderError, match="no release to go back to"):
        at_once(store.revert())


def test_a_damaged_release_is_no_way_back():
    backing = updated(TWO)
    damage(backing, Slot.A)
    store, _ = booted(backing)
    assert at_once(store.revert()) == Verdict.WRONG_HASH
    assert name_of(booted(backing)[1]) == "two"


# Damage.


def test_when_the_confirmed_release_is_damaged_the_one_before_boots():
    backing = updated(TWO)
    damage(backing, Slot.B)
    store, boot = booted(backing)
    assert (name_of(boot), boot.reason, boot.verdicts[Slot.B]) == ("one", BootReason.FALLBACK, Verdict.WRONG_HASH)
    before = bytes(backing.memory.slots[Slot.A])
    assert transfer(store, TWO) == 0  # the same image, but what stands there is known to be bad
    assert at_once(store.finish()) == Verdict.GOOD
    store.activate()
    assert backing.memory.slots[Slot.A] == before
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


# Transfer.


def test_an_interrupted_transfer_goes_on_where_it_ended():
    backing = provisioned()
    store, _ = booted(backing)
    transfer(store, TWO, until=2 * BLOCK)
    assert store.received == 2 * BLOCK
    store, _ = booted(backing.after_power_on())
    assert transfer(store, TWO) == 2 * BLOCK
    assert at_once(store.finish()) == Verdict.GOOD


def test_a_transfer_goes_on_in_another_session_too():
    store, _ = booted(provisioned())
    transfer(store, TWO, until=2 * BLOCK)
    store.drop()
    assert store.received is None
    assert transfer(store, TWO) == 2 * BLOCK
    store.drop()
    assert transfer(store, TWO) == len(TWO)
    assert at_once(store.finish()) == Verdict.GOOD
    store.drop()
    assert transfer(store, TWO) == len(TWO)
    assert at_once(store.finish()) == Verdict.GOOD


@pytest.mark.parametrize(
    ("length", "sha256"),
    [(len(TWO) - 1, hashlib.sha256(TWO).digest()), (len(TWO), hashlib.sha256(ONE).digest())],
)
def test_another_length_or_hash_begins_anew(length, sha256):
    backing = provisioned()
    store, _ = booted(backing)
    transfer(store, TWO, until=2 * BLOCK)
    store, _ = booted(backing.after_power_on())
    assert at_once(store.announce(length, sha256)) == 0
    assert backing.memory.slots[Slot.B] == b""


def test_an_image_that_failed_begins_anew():
    store, _ = booted(provisioned())
    wrong = image(key=STRANGER)
    assert flash(store, wrong) == Verdict.UNKNOWN_KEY
    assert phases(store) == [Phase.CONFIRMED, Phase.BAD]
    assert transfer(store, wrong) == 0


def test_an_image_is_not_checked_before_it_is_whole():
    store, _ = booted(provisioned())
    transfer(store, TWO, until=BLOCK)
    assert at_once(store.finish()) == Verdict.INCOMPLETE
    assert phases(store) == [Phase.CONFIRMED, Phase.FILLING]
    assert transfer(store, TWO) == BLOCK
    assert at_once(store.finish()) == Verdict.GOOD
    assert at_once(store.finish()) == Verdict.GOOD  # as if the answer had been lost


def test_what_arrives_must_be_what_was_announced():
    store, _ = booted(provisioned())
    at_once(store.announce(len(TWO), hashlib.sha256(TWO).digest()))
    store.append(TWO[:-1])
    store.append(b"\0" if TWO[-1] else b"\1")
    assert at_once(store.finish()) == Verdict.WRONG_HASH
    with pytest.raises(OutOfOrderError):
        store.activate()


def test_no_more_bytes_are_taken_than_were_announced():
    store, _ = booted(provisioned())
    transfer(store, TWO)
    with pytest.raises(OutOfOrderError, match="must end at the announced"):
        store.append(b"x")


def test_nothing_is_taken_without_an_announcement():
    store, _ = booted(provisioned())
    with pytest.raises(OutOfOrderError, match="announce it first"):
        store.append(b"x")
    with pytest.raises(OutOfOrderError, match="announce it first"):
        at_once(store.finish())


@pytest.mark.parametrize(("length", "sha256"), [(0, bytes(32)), (200_001, bytes(32)), (5, bytes(31)), (-1, bytes(32))])
def test_what_cannot_be_an_image_is_not_announced(length, sha256):
    backing = provisioned()
    store, _ = booted(backing)
    calls = backing.calls
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


@pytest.mark.parametrize("images", [(), (TWO,), (TWO, ONE)])
def test_the_running_confirmed_image_is_never_written(images):
    backing = updated(*images)
    store, boot = booted(backing)
    before = bytes(backing.memory.slots[boot.slot])
    for name in "abc":
        transfer(store, image(name), until=BLOCK)
        assert backing.memory.slots[boot.slot] == before


# Keys.


def test_a_key_list_replaces_the_one_before():
    backing = provisioned()
    store, _ = booted(backing)
    store.take_keys(keys(2, RELEASE, SECOND))
    assert flash(store_booted := booted(backing)[0], image(key=SECOND)) == Verdict.GOOD
    assert store_booted.keys.version == 2


@pytest.mark.parametrize("version", [1, 2, 3])
def test_an_older_key_list_is_no_key_list(version):
    """Signed by the root key once; whoever brings it again would bring a revoked key back."""
    backing = provisioned()
    store, _ = booted(backing)
    store.take_keys(keys(3, RELEASE, revoked=(SECOND,)))
    with pytest.raises(KeyFileError, match=f"version {version}: must be greater than 3"):
        store.take_keys(keys(version, RELEASE, SECOND))
    assert flash(booted(backing)[0], image(key=SECOND)) == Verdict.REVOKED_KEY


def test_a_key_list_by_another_root_is_refused():
    backing = provisioned()
    store, _ = booted(backing)
    other = Store(backing, root=public_key(STRANGER), hardware=HARDWARE, fits=fits)
    assert (store.keys is None, other.keys is None) == (False, True)
    with pytest.raises(KeyFileError, match="must be by the root key"):
        other.take_keys(keys(2))


def test_a_key_list_that_disowns_the_confirmed_release_is_refused():
    backing = provisioned()
    store, _ = booted(backing)
    with pytest.raises(KeyFileError, match="which signed the confirmed release"):
        store.take_keys(keys(2, SECOND, revoked=(RELEASE,)))
    store.take_keys(keys(2, RELEASE, SECOND))
    assert flash(store, image("two", key=SECOND)) == Verdict.GOOD
    store, _ = booted(backing)
    with pytest.raises(KeyFileError, match="which signed the confirmed release"):  # it is the way back of the trial
        store.take_keys(keys(3, SECOND, revoked=(RELEASE,)))
    store.confirm()
    store.take_keys(keys(3, SECOND, revoked=(RELEASE,)))
    store, boot = booted(backing)
    assert name_of(boot) == "two"
    assert at_once(store.revert()) == Verdict.REVOKED_KEY


def test_a_trial_ends_when_its_key_is_revoked():
    backing = provisioned()
    store, _ = booted(backing)
    store.take_keys(keys(2, RELEASE, SECOND))
    flash(store, image("two", key=SECOND))
    store, _ = booted(backing)
    store.take_keys(keys(3, RELEASE, revoked=(SECOND,)))
    _, boot = booted(backing)
    assert (name_of(boot), boot.verdicts[Slot.B]) == ("one", Verdict.REVOKED_KEY)


# What else is kept.


def test_a_calibration_belongs_to_one_release():
    backing = provisioned()
    store, boot = booted(backing)
    one = boot.bundle.digest
    store.keep_calibration(b"of one")
    flash(store, TWO)
    store, boot = booted(backing)
    assert (store.calibration(one), store.calibration(boot.bundle.digest)) == (b"of one", None)
    store.keep_calibration(b"of two")
    assert at_once(store.revert()) == Verdict.GOOD
    store, boot = booted(backing)
    assert (boot.bundle.digest, store.calibration(one)) == (one, b"of one")
    store.keep_calibration(None)
    assert booted(backing)[0].calibration(one) is None


def test_a_calibration_goes_with_its_release():
    backing = updated()
    store, boot = booted(backing)
    gone = boot.bundle.digest
    store.keep_calibration(b"x" * 1024)
    for name in "abc":
        flash(store, image(name))
        store, boot = booted(backing)
        store.confirm()
        store.keep_calibration(b"y" * 1024)
        assert store.calibration(boot.bundle.digest) == b"y" * 1024
    assert store.calibration(gone) is None


def test_a_calibration_is_kept_only_while_a_release_runs_and_only_a_small_one():
    store = store_on(provisioned())
    with pytest.raises(OutOfOrderError, match="one must run"):
        store.keep_calibration(b"x")
    store.boot()
    with pytest.raises(ConfigError, match="1025 bytes"):
        store.keep_calibration(b"x" * 1025)


def test_failed_attempts_outlive_a_reset():
    backing = provisioned()
    store, _ = booted(backing)
    store.keep_failed_attempts(Level.PROGRAMMING, 2)
    store.keep_failed_attempts(Level.CALIBRATION, 400)
    store = store_on(backing.after_power_on())
    assert [store.failed_attempts(level) for level in Level] == [2, 255]
    store.boot()
    flash(store, TWO)
    assert [store.failed_attempts(level) for level in Level] == [2, 255]
