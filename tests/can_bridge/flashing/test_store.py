"""Production, trial, confirmation, and the way back."""

import pytest

from can_bridge.flashing.backing import Kind, Slot, at_once
from can_bridge.flashing.boot import BootReason
from can_bridge.flashing.medium import PowerCut
from can_bridge.flashing.state import TRIAL_BOOTS, Phase
from can_bridge.flashing.store import OutOfOrderError, Store
from can_bridge.flashing.verdicts import Verdict
from contract.errors import ConfigError, KeyFileError
from contract.release.signing import public_key
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import (
    BLOCK,
    HARDWARE,
    ROOT,
    STRANGER,
    booted,
    damage,
    fits,
    flash,
    image,
    keys,
    name_of,
    phases,
    provisioned,
    store_on,
    transfer,
    updated,
)

ONE, TWO = image("one"), image("two")


def test_an_ecu_leaves_production_with_a_confirmed_release():
    store, boot = booted(provisioned())
    assert (boot.slot, boot.reason, boot.verdicts) == (Slot.A, BootReason.CONFIRMED, {Slot.A: Verdict.GOOD})
    assert name_of(boot) == "one"
    assert store.state.least_security_version == 1
    assert store.running == store.state.active == Slot.A
    assert store.last_boot is boot
    assert boot.reason.in_words == "confirmed"


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


def test_production_can_be_repeated_after_a_loss_of_power_in_any_call():
    at, was_cut = 0, True
    while was_cut:
        backing = PlainBacking(cut_at=at)
        try:
            provisioned(ONE, backing)
            was_cut = False
        except PowerCut:
            backing = backing.after_power_on()
            if booted(backing)[1].reason == BootReason.NO_RELEASE:
                provisioned(ONE, backing)
        assert name_of(booted(backing.after_power_on())[1]) == "one"
        at += 1
    assert at > 20


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
    before, records = backing.content(Slot.A), dict(backing.memory.records)
    store, _ = booted(backing)
    flash(store, TWO)
    found = [booted(backing := backing.after_power_on())[1] for _ in range(6)]
    assert [name_of(boot) for boot in found] == ["two", "two", "two", "one", "one", "one"]
    assert [boot.reason for boot in found[2:5]] == [BootReason.TRIAL, BootReason.REVERTED, BootReason.CONFIRMED]
    assert [boot.boots_left for boot in found] == [2, 1, 0, 0, 0, 0]
    assert backing.content(Slot.A) == before
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
    before = backing.content(Slot.A)
    transfer(store, image("three"), until=BLOCK)
    with pytest.raises(OutOfOrderError, match="no release to confirm"):
        store.confirm()
    assert flash(store, image("three")) == Verdict.GOOD
    with pytest.raises(OutOfOrderError, match="no release to confirm"):  # it is activated, and has not run
        store.confirm()
    assert backing.content(Slot.A) == before
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


def test_without_a_confirmed_release_a_second_trial_ends_the_first():
    backing = PlainBacking()
    Store.provision(backing, root=public_key(ROOT), keys=keys(), image=None, hardware=HARDWARE, fits=fits)
    flash(booted(backing)[0], ONE)
    store, boot = booted(backing)
    assert (name_of(boot), boot.slot) == ("one", Slot.A)
    assert flash(store, TWO) == Verdict.GOOD
    assert phases(store) == [Phase.BAD, Phase.TRIAL]
    with pytest.raises(OutOfOrderError):
        store.confirm()
    assert name_of(booted(backing)[1]) == "two"


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
