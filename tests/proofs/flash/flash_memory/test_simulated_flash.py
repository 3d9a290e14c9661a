"""The simulated flash has the manners that the stores above it must live with."""

from functools import partial
from itertools import product

import pytest

from can_bridge.flashing.medium import MediumError
from tests.can_bridge.flashing.medium import ERASED, WORD, PowerCut, UnreadableError, WornOutError
from tests.proofs.flash.flash_memory.simulated_flash import SimulatedFlash

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


def test_what_a_cut_tears_is_old_or_weak_or_random_or_unreadable():
    """A word that looks erased is weak: programmed again, it cannot be read. A whole erasure mends all."""
    became: dict[str, set[str]] = {"word": set(), "erasure": set()}
    for kind, seed in product(became, range(60)):
        flash = SimulatedFlash(1, SECTOR, seed=seed)
        if kind == "word":
            flash.cut_at = 1
            tear = partial(flash.program, 0, DATA * 3)
        else:
            flash.program(0, DATA * (WORDS - 1))
            flash.power_on(flash.operations)
            tear = partial(flash.erase, 0)
        for dead in (tear, partial(flash.read, 0, 1), partial(flash.erase, 0)):
            with pytest.raises(PowerCut):
                dead()
        flash.power_on()
        if kind == "word":
            assert (flash.read(0, WORD), flash.read(2 * WORD, WORD)) == (DATA, ERASED)
        for address in (WORD,) if kind == "word" else range(0, SECTOR, WORD):
            try:
                there = flash.read(address, WORD)
            except UnreadableError as error:
                assert error.address == address
                became[kind].add("unreadable")
                continue
            became[kind].add({DATA: "whole", ERASED: "weak"}.get(there, "random"))
            if kind == "word":
                # A cut programs no bit that was not to be programmed.
                assert all(is_there & to_be == to_be for is_there, to_be in zip(there, DATA, strict=True))
            if there == ERASED:
                flash.program(address, DATA)
                with pytest.raises(UnreadableError):
                    flash.read(address, WORD)
            else:
                with pytest.raises(MediumError, match="programmed before"):
                    flash.program(address, DATA)
        flash.erase(0)
        flash.program(0, DATA * WORDS)
        assert flash.read(0, SECTOR) == DATA * WORDS
    assert became == {kind: {"whole", "weak", "random", "unreadable"} for kind in became}


def test_sectors_fail_when_they_are_worn_out_or_bad():
    flash = SimulatedFlash(4, SECTOR, endurance=100, seed=3)
    for sector in range(4):
        with pytest.raises(WornOutError, match=f"sector {sector} can no longer be erased"):
            for _ in range(200):
                flash.erase(sector)
    assert all(90 <= count - 1 <= 110 for count in flash.erasures)
    assert len(set(flash.erasures)) > 1
    flash = SimulatedFlash(3, SECTOR, bad={1: 2, 2: 0})
    flash.erase(1)
    with pytest.raises(WornOutError, match="sector 1 can no longer be programmed"):
        flash.program(SECTOR, DATA * 3)
    assert flash.read(SECTOR, 3 * WORD) == DATA * 2 + ERASED
    for sector in (1, 2):
        with pytest.raises(WornOutError):
            flash.erase(sector)
