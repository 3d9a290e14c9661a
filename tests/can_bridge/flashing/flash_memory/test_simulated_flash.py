"""The simulated flash has the manners that the stores above it must live with."""

import pytest

from can_bridge.flashing.flash_memory.simulated_flash import SimulatedFlash
from can_bridge.flashing.medium import ERASED, WORD, MediumError, PowerCut, UnreadableError, WornOutError

WORDS = 8
SECTOR = WORDS * WORD
DATA = bytes(range(WORD))


def test_words_are_programmed_once_between_erasures():
    flash = SimulatedFlash(2, SECTOR)
    assert flash.read(0, 2 * SECTOR) == ERASED * 2 * WORDS
    flash.program(WORD, DATA * 2)
    assert flash.read(WORD - 1, 3) == b"\xff\x00\x01"
    with pytest.raises(MediumError, match="0x20 was programmed before"):
        flash.program(0, DATA * 2)
    # In order of their addresses: the first of the two words is there.
    assert flash.read(0, 3 * WORD) == DATA * 3
    flash.erase(0)
    flash.program(0, DATA)
    assert flash.operations == 2 + 2 + 1 + 1
    assert flash.erasures == (1, 0)


def test_only_whole_words_within_it_are_programmed_and_read():
    flash = SimulatedFlash(2, SECTOR)
    for address, data in ((1, DATA), (0, DATA[1:]), (2 * SECTOR, DATA), (-WORD, DATA)):
        with pytest.raises(MediumError, match="must be whole words"):
            flash.program(address, data)
    for address, length in ((0, 2 * SECTOR + 1), (-1, 1), (0, -1)):
        with pytest.raises(MediumError, match="must lie within 2 sectors"):
            flash.read(address, length)
    for sectors, size in ((0, SECTOR), (2, 0), (2, 33)):
        with pytest.raises(ValueError, match="must be 1 or more"):
            SimulatedFlash(sectors, size)


def torn_word(seed: int) -> SimulatedFlash:
    flash = SimulatedFlash(1, SECTOR, seed=seed)
    flash.cut_at = 1
    with pytest.raises(PowerCut):
        flash.program(0, DATA * 3)
    with pytest.raises(PowerCut):
        flash.read(0, 1)
    with pytest.raises(PowerCut):
        flash.erase(0)
    flash.power_on()
    assert flash.read(0, WORD) == DATA
    assert flash.read(2 * WORD, WORD) == ERASED
    return flash


def test_a_torn_word_is_weak_or_partly_there_or_unreadable():
    became = set()
    for seed in range(60):
        flash = torn_word(seed)
        try:
            found = flash.read(WORD, WORD)
        except UnreadableError as error:
            assert error.address == WORD
            became.add("unreadable")
            continue
        # A cut programs no bit that was not to be programmed.
        assert all(is_there & to_be == to_be for is_there, to_be in zip(found, DATA, strict=True))
        if found == ERASED:
            flash.program(WORD, DATA)
            with pytest.raises(UnreadableError):
                flash.read(WORD, WORD)
            became.add("weak")
        else:
            became.add("whole" if found == DATA else "part")
            with pytest.raises(MediumError, match="programmed before"):
                flash.program(WORD, DATA)
    assert became == {"unreadable", "weak", "whole", "part"}


def test_a_torn_erasure_leaves_each_word_old_or_weak_or_random_or_unreadable():
    became = set()
    for seed in range(20):
        flash = SimulatedFlash(1, SECTOR, seed=seed)
        flash.program(0, DATA * (WORDS - 1))
        flash.power_on(flash.operations)
        with pytest.raises(PowerCut):
            flash.erase(0)
        flash.power_on()
        for address in range(0, SECTOR, WORD):
            try:
                found = flash.read(address, WORD)
            except UnreadableError:
                became.add("unreadable")
                continue
            became.add({DATA: "old", ERASED: "weak"}.get(found, "random"))
            if found == ERASED:
                flash.program(address, DATA)
                with pytest.raises(UnreadableError):
                    flash.read(address, WORD)
        flash.erase(0)
        flash.program(0, DATA * WORDS)
        assert flash.read(0, SECTOR) == DATA * WORDS
    assert became == {"old", "weak", "random", "unreadable"}


def test_sectors_wear_out():
    flash = SimulatedFlash(4, SECTOR, endurance=100, seed=3)
    lived = []
    for sector in range(4):
        with pytest.raises(WornOutError, match=f"sector {sector} can no longer be erased"):
            for _ in range(200):
                flash.erase(sector)
        lived.append(flash.erasures[sector] - 1)
    assert all(90 <= count <= 110 for count in lived)
    assert len(set(lived)) > 1


def test_a_bad_sector_fails_when_its_words_are_used_up():
    flash = SimulatedFlash(3, SECTOR, bad={1: 2, 2: 0})
    flash.erase(1)
    with pytest.raises(WornOutError, match="sector 1 can no longer be programmed"):
        flash.program(SECTOR, DATA * 3)
    assert flash.read(SECTOR, 3 * WORD) == DATA * 2 + ERASED
    with pytest.raises(WornOutError):
        flash.erase(1)
    with pytest.raises(WornOutError):
        flash.erase(2)
