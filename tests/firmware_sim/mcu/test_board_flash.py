"""The board's flash through its driver in machine code: write-once words, torn ones, cuts, and the next power cycle."""

from pathlib import Path
from typing import Any

import pytest

from contract.errors import McuError
from firmware_sim.mcu.board.board import BANK, Board
from firmware_sim.mcu.board.flash_controller import SECTOR, WORD, FlashBank, FlashTimes, PowerCut
from firmware_sim.mcu.board.small_parts import SystemReset
from firmware_sim.mcu.build import Firmware, compile_board, read_elf
from tests.each import each

pytestmark = pytest.mark.mcu
WORDS = [bytes(range(k, k + WORD)) for k in (1, 60)]
CALLED = Path(__file__).with_name("c").joinpath("flash_calls.c").read_bytes()
NAMES = b"erase erased program read word store byte random reset"
KEPT = b"EXTERN(vectors " + b" ".join(b"test_" + name for name in NAMES.split())


@pytest.fixture(scope="module")
def firmware(sources) -> Firmware:
    script = sources["board/sw_board.ld"].replace(b"EXTERN(vectors sw_board_ecu sw_board_steps", KEPT)
    return read_elf(compile_board(sources, {"sw_board_main.c": CALLED, "sw_board.ld": script}))


class Driven:
    def __init__(self, firmware: Firmware, bank: FlashBank | None = None, **facts: Any) -> None:
        self.board = Board(firmware, bank, **facts)
        self.board.run()

    def program(self, address: int, word: bytes) -> int:
        self.board.poke(self.board.symbol("test_data"), word)
        return self.board.call("test_program", address)

    def read(self, address: int) -> tuple[int, bytes]:
        return self.board.call("test_read", address), self.board.peek(self.board.symbol("test_data"), 64)


def test_words_are_written_once_and_sectors_are_erased(firmware):
    driven = Driven(firmware)
    at = 3 * SECTOR
    assert [driven.program(at + k * WORD, word) for k, word in enumerate(WORDS)] == [0, 0]
    assert driven.read(at) == (0, b"".join(WORDS))
    assert driven.board.call("test_word", BANK + at) == int.from_bytes(WORDS[0][:4], "little")
    # A second time it is neither, and cannot be read, not even where the two are the same.
    for word in (WORDS[1], WORDS[0]):
        assert driven.program(at, word) == 0
        failed, data = driven.read(at)
        assert (failed, data[WORD:]) == (1, WORDS[1])
        assert driven.read(at + WORD)[0] == 0
    assert driven.read(at - WORD)[0] == 1
    # The error is in the memory: the next power cycle finds it, and a read without the driver's care is a bus fault.
    driven = Driven(firmware, FlashBank.unpack(driven.board.flash.bank.pack()))
    assert driven.read(at)[0] == 1
    with pytest.raises(McuError, match="bus fault"):
        driven.board.call("test_word", BANK + at)
    assert driven.board.call("test_erase", 3) == 0
    assert driven.read(at) == (0, b"\xff" * 64)
    assert driven.program(at, WORDS[1]) == 0
    assert driven.read(at) == (0, WORDS[1] + b"\xff" * WORD)
    assert driven.read(0) == (0, b"\xff" * 64)
    assert driven.board.flash.operations == 2


def test_what_the_driver_refuses_never_reaches_the_memory(firmware):
    driven = Driven(firmware)
    refused = [driven.board.call("test_erase", 8), driven.program(8 * SECTOR, WORDS[0]), driven.program(4, WORDS[0])]
    assert refused == [1, 1, 1]
    assert [driven.board.call("test_read", at) for at in (8 * SECTOR - 32, 2**32 - 32, 8 * SECTOR - 64)] == [1, 1, 0]
    assert driven.board.flash.operations == 0
    # A store outside an operation of the controller is an error of its, as is a wrong key until the next reset.
    flash = driven.board.flash
    flash.store(0, b"1234")
    assert flash.read(0x10) >> 18 & 1
    flash.write(0x04, 1)
    assert driven.board.call("test_erase", 0) == 1
    for wrong in (FlashBank().pack()[1:], b"\x03" + FlashBank().pack()[1:]):
        with pytest.raises(McuError, match="must be"):
            FlashBank.unpack(wrong)


def test_operations_take_their_time_and_a_read_amid_one_waits_for_its_end(firmware):
    driven = Driven(firmware, times=FlashTimes(erase_ns=700_000_000, word_ns=90_000))
    board, counter = driven.board, driven.board.counter
    assert driven.program(0, WORDS[0]) == 0 and counter.now_ns == 90_000
    assert (board.call("test_erase", 0), board.call("test_erased"), counter.now_ns < 1_000_000) == (0, 2, True)
    # A core that does something else meanwhile finds it done; one that reads this bank stands still until then.
    counter.now_ns += 300_000_000
    assert (board.call("test_erased"), board.flash.stalled_ns) == (2, 0)
    assert driven.read(SECTOR) == (0, b"\xff" * 64) and counter.now_ns == 700_090_000
    assert board.flash.stalled_ns > 399_000_000 and board.call("test_erased") == 0
    assert (driven.read(0), counter.now_ns) == ((0, b"\xff" * 64), 700_090_000)
    # One that ends with the core's reset leaves no sector that can be read, one that hangs is given up.
    assert board.call("test_erase", 1) == 0
    board.flash.reset()
    assert Driven(firmware, board.flash.bank).read(SECTOR)[0] == 1
    board.flash._until_ns += 10_000_000_000
    counter.now_ns += 5_000_000_000
    assert board.call("test_erased") == 1


@each("cut_at", [1, 2, 3])
def test_a_supply_that_fails_leaves_what_is_torn(firmware, cut_at):
    """By the operation: an erasure, or one of two words."""
    bank = FlashBank()
    driven = Driven(firmware, bank, cut_at=cut_at, seed=cut_at)
    with pytest.raises(PowerCut):
        driven.board.call("test_erase", 0)
        for k, word in enumerate(WORDS):
            driven.program(k * WORD, word)
    assert bank.programmed[:3] == {1: b"\2\2\2", 2: b"\2\0\0", 3: b"\1\2\0"}[cut_at]
    after = Driven(firmware, bank)
    assert [after.read(at)[0] for at in (0, WORD)] == {1: [1, 1], 2: [1, 0], 3: [1, 1]}[cut_at]
    torn = bank.content[(cut_at - 2) * WORD :][:WORD] if cut_at > 1 else b""
    # A bit that was to stay set is set; of the others some are.
    assert all(byte & kept == kept for byte, kept in zip(torn, WORDS[cut_at - 2], strict=False))
    assert torn != WORDS[cut_at - 2]


def test_what_is_not_modelled_is_an_error_in_one_line(firmware):
    for function, address, complaint in (
        ("test_store", 0x6000_0000, "the core stopped at 0x8"),
        ("test_store", 0x4000_A010, "no register to write at 0x10"),
        ("test_store", 0x5200_2164, "no register to write at 0x64"),
        ("test_store", 0x4000_A01C, "without INIT and CCE"),
        ("test_byte", 0x4000_A018, "accessed with 1 bytes"),
    ):
        with pytest.raises(McuError, match=complaint):
            Driven(firmware).board.call(function, address)


def test_random_numbers_and_the_reset(firmware):
    numbers = [Driven(firmware, seed=seed).board.call("test_random") for seed in (1, 1, 2)]
    assert numbers[0] == numbers[1] != numbers[2]
    driven = Driven(firmware)
    for failed in (False, True):
        driven.board.random.has_seed_error = failed
        driven.board.call("test_random")
        assert driven.board.peek(driven.board.symbol("test_data"), 1) == bytes([failed])
    with pytest.raises(SystemReset):
        Driven(firmware).board.call("test_reset")
