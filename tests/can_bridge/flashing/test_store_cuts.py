"""A loss of power in every writing call of every way to use the store, and in every call of the recovery from it.

That what was received is not sent again, and the whole way from the tester to a folder, is in `tests/proofs/flash`.
"""

import pickle
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import replace
from itertools import product
from typing import Any

import pytest

from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Slot, at_once
from can_bridge.flashing.remembered import Remembered
from can_bridge.flashing.state import TRIAL_BOOTS, SlotPhase, SlotState, StoreState
from can_bridge.flashing.store import Store
from can_bridge.flashing.verdicts import Verdict
from tests.can_bridge.flashing import releases
from tests.can_bridge.flashing.plain_backing import PlainBacking, PowerCut
from tests.can_bridge.flashing.releases import booted, flash, image, keys, name_of, provisioned, store_on, transfer

VERSIONS = {"one": 1, "two": 2, "three": 3}
IMAGES = {name: image(name, version=version) for name, version in VERSIONS.items()}
START = provisioned().memory

Story = Callable[[PlainBacking], None]


@pytest.fixture(autouse=True)
def _few_blocks(monkeypatch):
    monkeypatch.setattr(releases, "BLOCK", 10_000)


def confirmed_update(backing: PlainBacking) -> None:
    """What a tester does until release "two" is confirmed, whatever state the ECU is in."""
    store, boot = booted(backing)
    if name_of(boot) != "two":
        assert flash(store, IMAGES["two"]) == Verdict.GOOD
        store, boot = booted(backing)
    assert name_of(boot) == "two"
    store.confirm()


def not_confirmed(backing: PlainBacking) -> None:
    """Another image is begun, and it ends on trial in place of another; then it is left alone."""
    transfer(booted(backing)[0], IMAGES["two"], until=10_000)
    flash(booted(backing)[0], IMAGES["three"])
    flash(booted(backing)[0], IMAGES["two"])
    for _ in range(TRIAL_BOOTS + 1):
        _, boot = booted(backing)
    assert name_of(boot) == "one"


def taken_back(backing: PlainBacking) -> None:
    flash(booted(backing)[0], IMAGES["two"])
    store, _ = booted(backing)
    at_once(store.revert())
    assert name_of(booted(backing)[1]) == "one"


def other_records(backing: PlainBacking) -> None:
    store, _ = booted(backing)
    store.keep_failed_attempts(Level.PROGRAMMING, 1)
    store.take_keys(keys(2))
    store.keep_calibration(b"x" * 40)
    store.keep_failed_attempts(Level.PROGRAMMING, 0)


STORIES: tuple[Story, ...] = (confirmed_update, not_confirmed, taken_back, other_records)


def cuts(start: PlainBacking, story: Story, seed: int) -> Iterator[PlainBacking]:
    """The ECU after a loss of power in each writing call of a story; the last one came to its end.

    The seed decides what a cut call still does, and what is left of bytes that nothing made safe.
    """
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
    state = store_on(after).state
    assert state.active is not None
    confirmed = state.slots[state.active]
    assert after.content(state.active) == IMAGES[confirmed.name]
    assert state.least_security_version == VERSIONS[confirmed.name]

    left_alone = deepcopy(after)
    for _ in range(TRIAL_BOOTS + 2):
        left_alone = left_alone.after_power_on()
        _, boot = booted(left_alone)
        assert name_of(boot) in (confirmed.name, "two", "three")
    assert (name_of(boot), boot.slot) == (confirmed.name, state.active)

    flashed = deepcopy(after)
    confirmed_update(flashed)
    store, boot = booted(flashed.after_power_on())
    assert boot.slot is not None
    assert (name_of(boot), store.state.slots[boot.slot].phase) == ("two", SlotPhase.CONFIRMED)
    assert store.state.least_security_version == 2


@pytest.mark.slow
def test_after_one_or_two_losses_of_power_in_any_call_a_release_runs_and_the_next_flash_succeeds():
    afters = list[PlainBacking]()
    for story, seed in product(STORIES, range(2)):
        found = list(cuts(PlainBacking(START), story, seed))
        assert len(found) >= 5, story
        afters += found
    for after in cuts(PlainBacking(START), confirmed_update, 0):
        afters += cuts(after, confirmed_update, 1)
    for after in {pickle.dumps(after.memory): after for after in afters}.values():
        prove(after)


def received_before_it_is_written(self: Store, data: bytes) -> None:
    slot, standing = self._transfer()
    self.keep_slot(slot, replace(standing, received=standing.received + len(data)))
    self.backing.append(slot, data)


def counter_first(self: Store, slot: Slot, whole: Any = Store._confirm) -> None:
    self.keep(replace(self.state, least_security_version=self.state.slots[slot].security_version))
    whole(self, slot)


def believed_while_it_is_cleared(self: Remembered, state: StoreState, whole: Any = Remembered.keep) -> None:
    if any(slot.phase is SlotPhase.EMPTY for slot in state.slots):
        self.state = state
    else:
        whole(self, state)


@pytest.mark.slow
def test_planted_defects_are_found(monkeypatch):
    defects: tuple[tuple[type, str, Any, Story], ...] = (
        (Store, "_writable_slot", lambda self: Slot.A, confirmed_update),
        (Remembered, "keep", believed_while_it_is_cleared, not_confirmed),
        (Store, "append", received_before_it_is_written, confirmed_update),
        # Confirmed when activated.
        (Store, "activate", lambda self: self._confirm(self.state.checked), not_confirmed),
        (Store, "_confirm", counter_first, confirmed_update),
        # Resumed whatever it was.
        (SlotState, "holds", lambda self, length, sha256: self.phase == SlotPhase.FILLING, not_confirmed),
    )
    for owner, name, defect, story in defects:
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, defect)
            # An assertion, or whatever the defect led to.
            with pytest.raises(Exception):  # noqa: B017
                for after in cuts(PlainBacking(START), story, 0):
                    prove(after)
