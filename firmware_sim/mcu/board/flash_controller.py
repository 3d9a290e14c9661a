"""The second bank of an STM32H743's flash with its controller (RM0433, section 4), as far as the firmware uses it.

A sector of 128 KiB is erased as a whole. A word of 32 bytes is programmed once, by eight stores of four bytes that fill
the write buffer. Each word has its own error-correcting code. A word becomes unreadable if it is programmed twice, or
if the supply fails while it is programmed. After a second programming, a bit is 1 only if both writes left it at 1.
After a failure of the supply, some bits that the write should have cleared may still be 1. A read of an unreadable word
finds an error that cannot be corrected. Such a read is a bus fault, unless the core ignores bus faults at that moment.

During an operation SR2 shows BSY and QW. The time advances with each read of SR2, so that a core that polls SR2 makes
progress. A core that reads this bank during an operation stalls until the operation has ended. The core can read the
other bank meanwhile. The start of an operation before the end of the previous one in this bank is an error.

Modelled: KEYR2 (both keys), CR2 (LOCK, PG, SER, SNB, START), SR2 (BSY, WBNE, QW, WRPERR, PGSERR, STRBERR, INCERR,
DBECCERR), CCR2, ECC_FA2R. Not modelled: erasing a bank.
"""

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from contract.errors import McuError
from firmware_sim.mcu.board.small_parts import Counter

SECTOR: Final = 128 * 1024
SECTORS: Final = 8
WORD: Final = 32
_KEYS: Final = (0x4567_0123, 0xCDEF_89AB)
_LOCK, _PG, _SER, _START = 1, 2, 4, 1 << 7
_BSY, _WBNE, _QW = 1, 2, 4
_LOOK_NS: Final = 5_000  # time in ns by which a read of SR2 advances the clock; it is long, so few reads are needed
_PGSERR, _STRBERR, _INCERR, _DBECCERR = (1 << bit for bit in (18, 19, 21, 26))
_ERRORS: Final = 0x0FFF_0000


class PowerCut(Exception):  # noqa: N818
    """An exception that ends a power cycle, because the supply failed in the middle of a flash operation."""


@dataclass(frozen=True, kw_only=True)
class FlashTimes:
    """The durations of flash operations in ns. The defaults are typical values in the STM32H743's datasheet (DS12110,
    flash memory programming, parallelism of 64 bits); the largest values in the datasheet are at most twice as long."""

    erase_ns: int = 1_000_000_000
    word_ns: int = 100_000


STM32H743: Final = FlashTimes()


class FlashBank:
    """The contents of a flash bank, and the states of its words: 0 erased, 1 programmed, 2 unreadable."""

    def __init__(self) -> None:
        self.content = bytearray(b"\xff" * SECTOR * SECTORS)
        self.programmed = bytearray(SECTOR * SECTORS // WORD)

    def pack(self) -> bytes:
        return bytes(self.programmed + self.content)

    @classmethod
    def unpack(cls, packed: bytes) -> "FlashBank":
        """Read the result of `pack`; raises McuError if it is not a packed bank."""
        bank, words = cls(), SECTOR * SECTORS // WORD
        if len(packed) != words * (WORD + 1) or max(packed[:words]) > 2:
            raise McuError(f"a flash of {len(packed)} bytes: must be {words * (WORD + 1)}, with word states of 0 to 2")
        bank.programmed[:], bank.content[:] = packed[:words], packed[words:]
        return bank


class FlashController:
    """The registers of a flash bank's controller, which change the bank in place. `changed` is called after each change
    with (offset of the first changed byte, number of changed bytes). `counter` advances during operations;
    `firmware_sim.mcu.board.board.Board` explains `cut_at` and `seed`. `operations` counts erased sectors and programmed
    words, `erasures` only sectors; `stalled_ns` is the total time for which the core stalled in reads of the bank."""

    def __init__(
        self,
        bank: FlashBank,
        changed: Callable[[int, int], None],
        *,
        counter: Counter | None = None,
        times: FlashTimes = STM32H743,
        cut_at: int = 0,
        seed: int = 0,
    ) -> None:
        self.bank, self._changed, self._cut_at = bank, changed, cut_at
        self._counter, self._times = counter or Counter(), times
        self._until_ns, self._erasing = 0, -1
        self.erasures = self.stalled_ns = 0
        self._random = random.Random(seed)
        self._keys, self._control, self._status, self._fault = 0, _LOCK, 0, 0
        self._buffer: dict[int, bytes] = {}
        self.operations = 0

    def read(self, offset: int) -> int:
        at_work = _BSY | _QW if self.is_at_work else 0
        known = {0x0C: self._control, 0x10: self._status | at_work | (_WBNE if self._buffer else 0), 0x60: self._fault}
        if offset not in known:
            raise McuError(f"flash controller: no register to read at {offset:#x}")
        if at_work:
            self._counter.now_ns = min(self._counter.now_ns + _LOOK_NS, self._until_ns)
        return known[offset]

    def write(self, offset: int, value: int) -> None:
        """Write a register. Raises PowerCut if the supply fails; McuError if the write is not modelled."""
        if offset == 0x04:
            right = self._keys < len(_KEYS) and value == _KEYS[self._keys]
            # A wrong key locks CR2 until the next reset.
            self._keys = self._keys + 1 if right else len(_KEYS) + 1
            self._control &= ~_LOCK if self._keys == len(_KEYS) else ~0
        elif offset == 0x0C:
            if not self._control & _LOCK:
                self._control = value & ~_START
                self._keys = 0 if value & _LOCK else self._keys
                if value & _START and value & _SER:
                    self._erase(value >> 8 & 7)
                elif value & _START:
                    raise McuError(f"flash controller: CR2 {value:#x} is not modelled: only a sector can be erased")
        elif offset == 0x14:
            self._status &= ~(value & _ERRORS)
        else:
            raise McuError(f"flash controller: no register to write at {offset:#x}")

    def store(self, offset: int, data: bytes) -> None:
        """Store four bytes in the write buffer; a full buffer is programmed. Raises PowerCut if the supply fails."""
        word = offset // WORD * WORD
        if self._control & _LOCK or not self._control & _PG or len(data) != 4:
            self._status |= _PGSERR
        elif self._buffer and word != min(self._buffer) // WORD * WORD:
            self._status |= _INCERR
        elif offset in self._buffer:
            self._status |= _STRBERR
        else:
            self._buffer[offset] = data
            if len(self._buffer) == WORD // 4:
                data = b"".join(self._buffer[at] for at in sorted(self._buffer))
                self._buffer = {}
                self._program(word, data)

    @property
    def is_at_work(self) -> bool:
        return self._counter.now_ns < self._until_ns

    def stall(self) -> None:
        """Advance the time to the end of the present operation, for which a core that reads the bank must wait."""
        self.stalled_ns += max(self._until_ns - self._counter.now_ns, 0)
        self._counter.now_ns = max(self._counter.now_ns, self._until_ns)

    def reset(self) -> None:
        """Simulate a reset of the core. A sector that was being erased gets undefined contents."""
        if self.is_at_work and self._erasing >= 0:
            self._change_sector(self._erasing, self._random.randbytes(SECTOR), 2)

    def finds_bad(self, offset: int) -> bool:
        """Return whether a read at this offset finds an error that cannot be corrected; the registers then show it."""
        if self.bank.programmed[offset // WORD] != 2:
            return False
        self._status |= _DBECCERR
        self._fault = offset // WORD
        return True

    def _erase(self, sector: int) -> None:
        is_cut = self._begins(self._times.erase_ns)
        self.erasures, self._erasing = self.erasures + 1, sector
        self._change_sector(sector, self._random.randbytes(SECTOR) if is_cut else b"\xff" * SECTOR, 2 if is_cut else 0)
        if is_cut:
            raise PowerCut

    def _program(self, at: int, data: bytes) -> None:
        is_cut, bank = self._begins(self._times.word_ns), self.bank
        self._erasing = -1
        if is_cut:
            data = bytes(byte | kept for byte, kept in zip(data, self._random.randbytes(WORD), strict=True))
        left = bytes(byte & old for byte, old in zip(data, bank.content[at : at + WORD], strict=True))
        self._change(at, left, b"\2" if is_cut or bank.programmed[at // WORD] else b"\1")
        if is_cut:
            raise PowerCut

    def _begins(self, takes_ns: int) -> bool:
        """Start an operation of `takes_ns` ns; return whether the supply fails in this operation."""
        if self.is_at_work:
            raise McuError("flash controller: an operation begins before the last operation has ended")
        self._until_ns = self._counter.now_ns + takes_ns
        self.operations += 1
        return self.operations == self._cut_at

    def _change_sector(self, sector: int, content: bytes, programmed: int) -> None:
        self._change(sector * SECTOR, content, bytes([programmed]) * (SECTOR // WORD))

    def _change(self, at: int, content: bytes, programmed: bytes) -> None:
        self.bank.content[at : at + len(content)] = content
        self.bank.programmed[at // WORD : at // WORD + len(programmed)] = programmed
        self._changed(at, len(content))
