"""The store's place in a flash memory: nothing that was kept is lost by a cut, nor by sectors that fail."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.flashing.backing import Kind, Slot
from can_bridge.flashing.flash_memory.flash_backing import FlashBacking
from can_bridge.flashing.flash_memory.flash_layout import MAX_EXTENTS
from can_bridge.flashing.flash_memory.simulated_flash import SimulatedFlash
from can_bridge.flashing.medium import MediumError
from tests.can_bridge.flashing.sessions import Witness, run
from tests.examples import examples

SECTOR = 1024
PLAN = [(Slot.A, 1), (Slot.B, 2), (Slot.A, 3)]
LENGTHS = {1: 900, 2: 1301, 3: 620}
_TAKE = FlashBacking._take


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


def whole() -> int:
    flash = SimulatedFlash(10, SECTOR)
    play(flash, [])
    return flash.operations


@pytest.mark.slow
def test_every_cut_leaves_the_old_or_the_new():
    for cut in range(whole()):
        play(SimulatedFlash(10, SECTOR, seed=cut), [cut])


@pytest.mark.slow
def test_every_second_cut_too():
    plan, lengths = [(Slot.A, 1)], {1: 280}
    flash = SimulatedFlash(8, SECTOR)
    play(flash, [], plan=plan, lengths=lengths)
    for first in range(flash.operations):
        for second in range(0, flash.operations - first, 3):
            play(SimulatedFlash(8, SECTOR, seed=first + second), [first, second], plan=plan, lengths=lengths)


@pytest.mark.slow
@examples(300)
@given(st.integers(0, 2**32), st.lists(st.integers(0, 400), max_size=12))
def test_many_cuts_in_a_row(seed, cuts):
    play(SimulatedFlash(16, SECTOR, seed=seed), cuts)


@pytest.mark.slow
@examples(200)
@given(st.integers(0, 2**32), st.dictionaries(st.integers(3, 11), st.integers(0, 40), max_size=2), st.integers(0, 500))
def test_sectors_that_fail_are_left_for_spare_ones(seed, bad, cut):
    play(SimulatedFlash(12, SECTOR, seed=seed, bad=bad), [cut], log=3, bad=bad)


@examples(50)
@given(st.integers(0, 2), st.integers(0, 40), st.integers(0, 500))
def test_a_log_of_three_sectors_outlives_one_of_them(sector, words, cut):
    play(SimulatedFlash(11, SECTOR, bad={sector: words}), [cut], log=3)


def test_without_spare_sectors_the_failure_is_said():
    backing = FlashBacking(SimulatedFlash(6, SECTOR, bad={2: 0, 3: 0, 4: 0, 5: 0}))
    with pytest.raises(MediumError, match="no sector is left"):
        for _ in backing.clear(Slot.A):
            pass


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


def test_capacity_is_half_of_the_pool_without_the_spare_sectors():
    assert FlashBacking(SimulatedFlash()).capacity == 6 * 128 * 1024
    with pytest.raises(ValueError, match="6 or more"):
        FlashBacking(SimulatedFlash(5, SECTOR))


def test_a_full_slot_takes_no_byte_more():
    backing = FlashBacking(SimulatedFlash(8, SECTOR))
    for _ in backing.clear(Slot.B):
        pass
    backing.append(Slot.B, bytes(backing.capacity))
    with pytest.raises(MediumError, match="no more fit"):
        backing.append(Slot.B, b"x")
    assert backing.read(Slot.B, 0, backing.capacity) == bytes(backing.capacity)


def test_a_slot_has_to_be_prepared():
    backing = FlashBacking(SimulatedFlash(8, SECTOR))
    with pytest.raises(MediumError, match="clear it"):
        backing.append(Slot.A, b"x")
    with pytest.raises(MediumError, match="nothing was written"):
        backing.begin_again(Slot.A, 1)


def test_a_tester_that_begins_anew_costs_no_room():
    flash = SimulatedFlash(8, SECTOR)
    backing = FlashBacking(flash)
    for _ in backing.clear(Slot.A):
        pass
    backing.append(Slot.A, b"x" * 100)
    backing.keep(Kind.STATE, b"100")
    before = flash.operations
    for _ in range(300):
        backing.begin_again(Slot.A, 100)
    assert flash.operations == before


def test_after_too_many_interruptions_the_slot_must_be_cleared():
    flash = SimulatedFlash(8, 16 * 1024)
    backing = FlashBacking(flash)
    for _ in backing.clear(Slot.A):
        pass
    with pytest.raises(MediumError, match="clear it and begin again"):
        for received in range(0, 40 * (MAX_EXTENTS + 2), 40):
            backing = FlashBacking(flash)
            backing.begin_again(Slot.A, received)
            backing.append(Slot.A, b"x" * 40)
            backing.keep(Kind.STATE, b"a checkpoint")
    assert received >= 40 * (MAX_EXTENTS - 2)
    for _ in backing.clear(Slot.A):
        pass
    backing.append(Slot.A, b"z" * 100)
    assert backing.read(Slot.A, 0, 100) == b"z" * 100


def test_records_that_do_not_fit_are_refused():
    backing = FlashBacking(SimulatedFlash(8, SECTOR))
    with pytest.raises(ValueError, match="at most 8192"):
        backing.keep(Kind.KEYS, bytes(8193))
    with pytest.raises(MediumError, match="must fit into a sector"):
        backing.keep(Kind.KEYS, bytes(SECTOR))
    assert backing.records() == {}


@pytest.mark.slow
def test_planted_defects_are_found(monkeypatch):
    def found() -> bool:
        try:
            test_every_cut_leaves_the_old_or_the_new()
        except Exception:  # noqa: BLE001  (whatever shows it)
            return True
        return False

    with monkeypatch.context() as patch:
        patch.setattr("can_bridge.flashing.flash_memory.flash_log.zlib.crc32", lambda data: 7)
        assert found(), "no commit: any payload counts"
    with monkeypatch.context() as patch:
        patch.setattr(FlashBacking, "_tails_changed", lambda self: False)
        assert found(), "a checkpoint without the bytes that wait for a word"
    with monkeypatch.context() as patch:
        patch.setattr(FlashBacking, "_take", _take_without_a_word)
        assert found(), "words programmed where no layout says so"
    with monkeypatch.context() as patch:
        patch.setattr(FlashBacking, "_untouched", lambda self, extents, within: extents[-1].address + 32)
        assert found(), "going on where words may have been programmed"
    with monkeypatch.context() as patch:
        patch.setattr("can_bridge.flashing.flash_memory.flash_log._OPEN", 1)
        assert found(), "a new log sector counts from its first record on"


def _take_without_a_word(self, slot):
    self._keep_layout = lambda: None
    sector = _TAKE(self, slot)
    del self._keep_layout
    return sector
