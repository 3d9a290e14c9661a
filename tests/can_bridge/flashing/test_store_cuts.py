"""A loss of power in every writing call of every way to use the store, and in every call of the recovery from it."""

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import replace
from itertools import product

import pytest

from can_bridge.flashing import checking, remembered
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Slot, at_once
from can_bridge.flashing.medium import PowerCut
from can_bridge.flashing.state import TRIAL_BOOTS, Phase, SlotState
from can_bridge.flashing.store import Store
from can_bridge.flashing.verdicts import Verdict
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import booted, flash, image, keys, name_of, provisioned, store_on, transfer

IMAGES = {"one": image("one"), "two": image("two", version=2), "three": image("three", version=3)}
VERSIONS = {"one": 1, "two": 2, "three": 3}
SEEDS = range(2)
"""Of what a cut call still does, and of what is left of bytes that nothing made safe."""
START = provisioned().memory

Story = Callable[[PlainBacking], None]


@pytest.fixture(autouse=True)
def _judge_equal_bytes_once(monkeypatch):
    """The same images recur thousands of times here; a check depends on nothing but its arguments."""
    known: dict[object, object] = {}

    def check(raw: bytes, rules: checking.Rules) -> object:
        key = raw, rules.keys, rules.least_security_version
        if key not in known:
            known[key] = checking.check(raw, rules)
        return known[key]

    monkeypatch.setattr(remembered, "check", check)


def confirmed_update(backing: PlainBacking) -> None:
    """What a tester does until release "two" is confirmed, whatever state the ECU is in."""
    store, boot = booted(backing)
    if boot.bundle is None or name_of(boot) != "two":
        assert flash(store, IMAGES["two"]) == Verdict.GOOD
        store, boot = booted(backing)
    assert boot.bundle is not None
    assert name_of(boot) == "two"
    store.confirm()


def abandoned(backing: PlainBacking) -> None:
    """It is not confirmed."""
    flash(booted(backing)[0], IMAGES["two"])
    for _ in range(TRIAL_BOOTS + 1):
        _, boot = booted(backing)
    assert name_of(boot) == "one"


def taken_back(backing: PlainBacking) -> None:
    flash(booted(backing)[0], IMAGES["two"])
    store, _ = booted(backing)
    at_once(store.revert())
    assert name_of(booted(backing)[1]) == "one"


def over_a_trial(backing: PlainBacking) -> None:
    flash(booted(backing)[0], IMAGES["three"])
    flash(booted(backing)[0], IMAGES["two"])
    assert name_of(booted(backing)[1]) == "two"


def of_two_minds(backing: PlainBacking) -> None:
    """Another image is begun, and then the first one again."""
    for name in ("two", "three", "two"):
        transfer(booted(backing)[0], IMAGES[name], until=10_000)


def other_records(backing: PlainBacking) -> None:
    store, _ = booted(backing)
    store.records.keep_failed_attempts(Level.PROGRAMMING, 1)
    store.take_keys(keys(2))
    store.keep_calibration(b"x" * 40)
    store.records.keep_failed_attempts(Level.PROGRAMMING, 0)


STORIES: tuple[Story, ...] = (confirmed_update, abandoned, taken_back, over_a_trial, of_two_minds, other_records)


def cuts(start: PlainBacking, story: Story, seed: int) -> Iterator[PlainBacking]:
    """The ECU after a loss of power in each writing call of a story; the last one came to its end."""
    at, was_cut = 0, True
    while was_cut:
        backing = deepcopy(start).after_power_on(cut_at=at, seed=1000 * seed + at)
        try:
            story(backing)
            was_cut = False
        except PowerCut:
            pass
        yield backing.after_power_on()
        at += 1


def prove(after: PlainBacking) -> None:
    """What must be so after any loss of power."""
    store = store_on(after)
    state = store.state
    assert state.active is not None
    confirmed = state.slots[state.active]
    assert after.content(state.active) == IMAGES[confirmed.name]
    assert state.least_security_version == VERSIONS[confirmed.name]

    left_alone = deepcopy(after)
    for _ in range(TRIAL_BOOTS + 2):
        left_alone = left_alone.after_power_on()
        _, boot = booted(left_alone)
        assert boot.bundle is not None
        assert name_of(boot) in (confirmed.name, "two", "three")
    assert name_of(boot) == confirmed.name
    assert boot.slot == state.active

    flashed = deepcopy(after)
    confirmed_update(flashed)
    store, boot = booted(flashed.after_power_on())
    assert name_of(boot) == "two"
    assert boot.slot is not None
    assert store.state.slots[boot.slot].phase == Phase.CONFIRMED
    assert store.state.least_security_version == 2


@pytest.mark.slow
def test_after_a_loss_of_power_in_any_call_a_release_runs_and_the_next_flash_succeeds():
    for story in STORIES:
        for seed in SEEDS:
            afters = list(cuts(PlainBacking(START), story, seed))
            assert len(afters) >= 5, story
            for after in afters:
                prove(after)


@pytest.mark.slow
def test_so_it_is_after_a_second_one_in_any_call_of_the_recovery():
    for after in cuts(PlainBacking(START), confirmed_update, 0):
        for again in cuts(after, confirmed_update, 1):
            prove(again)


def test_what_was_received_before_a_loss_of_power_is_not_sent_again():
    wanted = []
    for after in cuts(PlainBacking(START), confirmed_update, 0):
        store = store_on(after)
        slot = store.state.slots[Slot.B]
        if slot.phase == Phase.FILLING:
            wanted.append(slot.received)
            assert transfer(store, IMAGES["two"]) == slot.received
    assert len(set(wanted)) > len(IMAGES["two"]) // 10_000
    assert max(wanted) == len(IMAGES["two"])


# Defects that were planted: what is above finds them.


def written_over(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Store, "_writable_slot", lambda self: Slot.A)


def believed_before_it_is_cleared(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Store, "_without", lambda self, slot: self.state)


def received_before_it_is_written(patch: pytest.MonkeyPatch) -> None:
    def append(self, data):
        slot, standing = self._transfer()
        self._remembered.keep_slot(slot, replace(standing, received=standing.received + len(data)))
        self._remembered.backing.append(slot, data)

    patch.setattr(Store, "append", append)


def confirmed_when_activated(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Store, "activate", lambda self: self._confirm(self.state.checked))


def counter_first(patch: pytest.MonkeyPatch) -> None:
    def confirm(self, slot, whole=Store._confirm):
        version = self.state.slots[slot].security_version
        self._remembered.keep(replace(self.state, least_security_version=version))
        whole(self, slot)

    patch.setattr(Store, "_confirm", confirm)


def resumed_whatever_it_was(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(SlotState, "holds", lambda self, length, sha256: self.phase == Phase.FILLING)


@pytest.mark.slow
def test_planted_defects_are_found(monkeypatch):
    for defect in (
        written_over,
        believed_before_it_is_cleared,
        received_before_it_is_written,
        confirmed_when_activated,
        counter_first,
        resumed_whatever_it_was,
    ):
        with monkeypatch.context() as patch:
            defect(patch)
            # An assertion, or whatever the defect led to.
            with pytest.raises(Exception):  # noqa: B017
                for story, seed in product(STORIES, range(4)):
                    for after in cuts(PlainBacking(START), story, seed):
                        prove(after)
