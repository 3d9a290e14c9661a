"""Key lists, calibrations and failed attempts."""

import pytest

from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Slot, at_once
from can_bridge.flashing.store import OutOfOrderError, Store
from can_bridge.flashing.verdicts import Verdict
from contract.errors import ConfigError, KeyFileError
from contract.release.signing import public_key
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import (
    RELEASE,
    SECOND,
    STRANGER,
    booted,
    damage,
    digest_of,
    flash,
    image,
    keys,
    name_of,
    provisioned,
    store_on,
)

TWO = image("two")


def trying_a_second_key(**changes: int) -> tuple[PlainBacking, Store]:
    """With key list 2, a release by the second key on trial."""
    backing = provisioned()
    store, _ = booted(backing)
    store.take_keys(keys(2, RELEASE, SECOND))
    assert flash(store, image("two", key=SECOND, **changes)) == Verdict.GOOD
    store, _ = booted(backing)
    assert store.keys is not None and store.keys.version == 2
    return backing, store


def test_only_a_newer_list_by_the_root_key_is_taken():
    """An older one was signed by the root key, too; whoever brings it again would bring a revoked key back."""
    backing = provisioned()
    store, _ = booted(backing)
    store.take_keys(keys(3, RELEASE, revoked=(SECOND,)))
    for version in (1, 2, 3):
        with pytest.raises(KeyFileError, match=f"version {version}: must be greater than 3"):
            store.take_keys(keys(version, RELEASE, SECOND))
    assert flash(booted(backing)[0], image(key=SECOND)) == Verdict.REVOKED_KEY
    other = store_on(backing, root=public_key(STRANGER))
    assert other.keys is None
    with pytest.raises(KeyFileError, match="must be by the root key"):
        other.take_keys(keys(4))


def test_a_key_list_that_disowns_the_confirmed_release_is_refused():
    store, _ = booted(provisioned())
    with pytest.raises(KeyFileError, match="which signed the confirmed release"):
        store.take_keys(keys(2, SECOND, revoked=(RELEASE,)))
    backing, store = trying_a_second_key()
    with pytest.raises(KeyFileError, match="which signed the confirmed release"):  # it is the way back of the trial
        store.take_keys(keys(3, SECOND, revoked=(RELEASE,)))
    store.confirm()
    store.take_keys(keys(3, SECOND, revoked=(RELEASE,)))
    store, boot = booted(backing)
    assert name_of(boot) == "two"
    assert at_once(store.revert()) == Verdict.REVOKED_KEY


def test_a_trial_whose_key_is_revoked_is_not_confirmed_and_ends():
    """It would not boot again, and the release before would be too old."""
    backing, store = trying_a_second_key(version=2)
    store.take_keys(keys(3, RELEASE, revoked=(SECOND,)))
    with pytest.raises(OutOfOrderError, match="taken off the list"):
        store.confirm()
    _, boot = booted(backing)
    assert (name_of(boot), boot.verdicts[Slot.B]) == ("one", Verdict.REVOKED_KEY)


def test_the_key_of_a_release_that_runs_because_the_confirmed_one_is_damaged_stays_too():
    backing, store = trying_a_second_key()
    store.confirm()
    damage(backing, Slot.B)
    store, boot = booted(backing)
    assert name_of(boot) == "one"
    with pytest.raises(KeyFileError, match=f"lacks key {public_key(RELEASE).fingerprint}"):
        store.take_keys(keys(3, SECOND))
    assert name_of(booted(backing)[1]) == "one"


def test_a_calibration_belongs_to_one_release_and_goes_with_it():
    backing = provisioned()
    store, boot = booted(backing)
    one = digest_of(boot)
    store.keep_calibration(b"of one")
    flash(store, TWO)
    store, boot = booted(backing)
    assert (store.records.calibration(one), store.records.calibration(digest_of(boot))) == (b"of one", None)
    store.keep_calibration(b"of two")
    assert at_once(store.revert()) == Verdict.GOOD
    store, boot = booted(backing)
    assert (digest_of(boot), store.records.calibration(one)) == (one, b"of one")
    store.keep_calibration(None)
    assert booted(backing)[0].records.calibration(one) is None
    store.keep_calibration(b"x" * 1024)
    for name in "abc":
        flash(store, image(name))
        store, boot = booted(backing)
        store.confirm()
        store.keep_calibration(b"y" * 1024)
        assert store.records.calibration(digest_of(boot)) == b"y" * 1024, name
    assert store.records.calibration(one) is None


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
    store.records.keep_failed_attempts(Level.PROGRAMMING, 2)
    store.records.keep_failed_attempts(Level.CALIBRATION, 400)
    calls = backing.calls
    store.records.keep_failed_attempts(Level.PROGRAMMING, 2)
    assert backing.calls == calls, "the memory wears out by writing what is there"
    store = store_on(backing.after_power_on())
    for _ in range(2):
        assert [store.state.failed_attempts[level] for level in Level] == [2, 255]
        store.boot()
        flash(store, TWO)
