"""The store's place in a flash memory: nothing that was kept is lost by a cut, nor by sectors that fail."""

import zlib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.flashing.backing import Kind, Slot
from can_bridge.flashing.medium import MediumError
from tests.can_bridge.flashing.sessions import Witness, run
from tests.examples import examples
from tests.proofs.flash.flash_memory import flash_log
from tests.proofs.flash.flash_memory.flash_backing import FlashBacking
from tests.proofs.flash.flash_memory.flash_layout import MAX_EXTENTS
from tests.proofs.flash.flash_memory.simulated_flash import SimulatedFlash

SECTOR = 1024
PLAN = [(Slot.A, 1), (Slot.B, 2), (Slot.A, 3)]
LENGTHS = {1: 900, 2: 1301, 3: 620}


def play(flash: SimulatedFlash, cuts: list[int], *, plan=PLAN, lengths=LENGTHS, log=2, bad=None) -> Witness:
    """The plan with cuts, each so many operations after the one before; then to its end."""
    witness = Witness(lengths)
    for cut in cuts:
        flash.power_on(flash.operations + cut)
        if run(lambda: FlashBacking(flash, log_sectors=log), witness, plan):
            return witness
    flash.power_on()
    assert run(lambda: FlashBacking(flash, log_sectors=log), witness, plan)
    # No word that a cut may have touched was programmed again: that would have looked like a bad sector.
    assert FlashBacking(flash, log_sectors=log)._layout.bad <= set(bad or {})
    return witness


def operations(*, sectors: int = 10, **changes: Any) -> int:
    """Of the plan without a cut."""
    flash = SimulatedFlash(sectors, SECTOR)
    play(flash, [], **changes)
    return flash.operations


@pytest.mark.slow
def test_every_cut_leaves_the_old_or_the_new(every: int = 2):
    """Every second one, and of those of one image every first with every third behind it."""
    for cut in range(0, operations(), every):
        play(SimulatedFlash(10, SECTOR, seed=cut), [cut])
    small: dict[str, Any] = {"plan": [(Slot.A, 1)], "lengths": {1: 280}}
    for first in range(count := operations(sectors=8, **small)):
        for second in range(first % 3, count - first, 3):
            play(SimulatedFlash(8, SECTOR, seed=first + second), [first, second], **small)


@pytest.mark.slow
@examples(100)
@given(st.integers(0, 2**32), st.lists(st.integers(0, 400), max_size=12))
def test_many_cuts_in_a_row(seed, cuts):
    play(SimulatedFlash(16, SECTOR, seed=seed), cuts)


@pytest.mark.slow
@examples(80)
@given(st.integers(0, 2**32), st.dictionaries(st.integers(3, 11), st.integers(0, 40), max_size=2), st.integers(0, 500))
def test_sectors_that_fail_are_left_for_spare_ones(seed, bad, cut):
    play(SimulatedFlash(12, SECTOR, seed=seed, bad=bad), [cut], log=3, bad=bad)


@examples(50)
@given(st.integers(0, 2), st.integers(0, 40), st.integers(0, 500))
def test_a_log_of_three_sectors_outlives_one_of_them(sector, words, cut):
    play(SimulatedFlash(11, SECTOR, bad={sector: words}), [cut], log=3)


def test_sectors_wear_alike():
    flash = SimulatedFlash(10, SECTOR)
    for number in range(200):
        backing = FlashBacking(flash)
        for _ in backing.clear(Slot(number % 2)):
            pass
        backing.append(Slot(number % 2), bytes(1500))
        backing.keep(Kind.STATE, bytes(40))
    pool = flash.erasures[2:]
    assert sum(pool) >= 400
    assert max(pool) <= min(pool) + 2
    assert abs(flash.erasures[0] - flash.erasures[1]) <= 1


def cleared(flash: SimulatedFlash, slot: Slot) -> FlashBacking:
    backing = FlashBacking(flash)
    for _ in backing.clear(slot):
        pass
    return backing


def test_what_does_not_fit_is_refused():
    """Capacity is half of the pool without the spare sectors."""
    assert FlashBacking(SimulatedFlash()).capacity == 6 * 128 * 1024
    with pytest.raises(ValueError, match="6 or more"):
        FlashBacking(SimulatedFlash(5, SECTOR))
    with pytest.raises(MediumError, match="no sector is left"):
        cleared(SimulatedFlash(6, SECTOR, bad={2: 0, 3: 0, 4: 0, 5: 0}), Slot.A)
    backing = cleared(SimulatedFlash(8, SECTOR), Slot.B)
    backing.append(Slot.B, bytes(backing.capacity))
    with pytest.raises(MediumError, match="no more fit"):
        backing.append(Slot.B, b"x")
    assert backing.read(Slot.B, 0, backing.capacity) == bytes(backing.capacity)
    with pytest.raises(MediumError, match="clear it"):
        backing.append(Slot.A, b"x")
    with pytest.raises(MediumError, match="nothing was written"):
        backing.begin_again(Slot.A, 1)
    with pytest.raises(ValueError, match="at most 8192"):
        backing.keep(Kind.KEYS, bytes(8193))
    with pytest.raises(MediumError, match="must fit into a sector"):
        backing.keep(Kind.KEYS, bytes(SECTOR))
    assert backing.records() == {}


def test_after_too_many_interruptions_the_slot_must_be_cleared():
    flash = SimulatedFlash(8, 16 * 1024)
    backing = cleared(flash, Slot.A)
    with pytest.raises(MediumError, match="clear it and begin again"):
        for received in range(0, 40 * (MAX_EXTENTS + 2), 40):
            backing = FlashBacking(flash)
            backing.begin_again(Slot.A, received)
            before = flash.operations
            backing.begin_again(Slot.A, received)  # again without a loss of supply: it costs no room
            assert flash.operations == before
            backing.append(Slot.A, b"x" * 40)
            backing.keep(Kind.STATE, b"a checkpoint")
    assert received >= 40 * (MAX_EXTENTS - 2)
    backing = cleared(flash, Slot.A)
    backing.append(Slot.A, b"z" * 100)
    assert backing.read(Slot.A, 0, 100) == b"z" * 100


def take_without_a_word(self: FlashBacking, slot: Slot, take: Any = FlashBacking._take) -> int:
    self._keep_layout = lambda: None  # type: ignore[method-assign]
    sector = take(self, slot)
    del self._keep_layout
    return int(sector)


@pytest.mark.slow
def test_planted_defects_are_found(monkeypatch):
    for owner, name, defect, words in (
        (zlib, "crc32", lambda data: 7, "no commit: any payload counts"),
        (FlashBacking, "_tails_changed", lambda self: False, "a checkpoint without the bytes that wait for a word"),
        (FlashBacking, "_take", take_without_a_word, "words programmed where no layout says so"),
        (FlashBacking, "_untouched", lambda self, extents, within: extents[-1].address + 32, "on touched words"),
        (flash_log, "_OPEN", 1, "a new log sector counts from its first record on"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, defect)
            try:
                test_every_cut_leaves_the_old_or_the_new(1)
            except Exception:  # noqa: BLE001  (whatever shows it)
                continue
        pytest.fail(words)
