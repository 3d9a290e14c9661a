"""The second bank of an STM32H743's flash with its controller (RM0433, section 4), as far as the firmware uses it.

A sector of 128 KiB is erased as a whole. A word of 32 bytes is programmed once, by eight stores of four bytes that fill
the write buffer. Each word has an error-correcting code of its own, so one that was programmed twice, or while the
supply failed, is not what either write meant: its bits are those that both left set, or some of them, and a read finds
an error that cannot be corrected. Such a read is a bus fault, unless the core ignores those for the moment.

Modelled: KEYR2 (both keys), CR2 (LOCK, PG, SER, SNB, START), SR2 (BSY, WBNE, QW, WRPERR, PGSERR, STRBERR, INCERR,
DBECCERR), CCR2, ECC_FA2R. Not modelled: the time that an operation takes, and erasing a bank.
"""

import random
from collections.abc import Callable
from typing import Final

from contract.errors import McuError

SECTOR: Final = 128 * 1024
SECTORS: Final = 8
WORD: Final = 32
_KEYS: Final = (0x4567_0123, 0xCDEF_89AB)
_LOCK, _PG, _SER, _START = 1, 2, 4, 1 << 7
_WBNE: Final = 2
_PGSERR, _STRBERR, _INCERR, _DBECCERR = (1 << bit for bit in (18, 19, 21, 26))
_ERRORS: Final = 0x0FFF_0000


class PowerCut(Exception):  # noqa: N818
    """The supply failed in the middle of an operation of the flash."""


class FlashBank:
    """What the bank holds, with or without supply.

    Attributes:
        content: bytes of all sectors.
        programmed: of each word, 0 erased, 1 programmed, 2 not readable.
    """

    def __init__(self) -> None:
        self.content = bytearray(b"\xff" * SECTOR * SECTORS)
        self.programmed = bytearray(SECTOR * SECTORS // WORD)

    def pack(self) -> bytes:
        """For a file."""
        return bytes(self.programmed + self.content)

    @classmethod
    def unpack(cls, packed: bytes) -> "FlashBank":
        """From `pack`; raises McuError for another size."""
        bank, words = cls(), SECTOR * SECTORS // WORD
        if len(packed) != words * (WORD + 1) or max(packed[:words]) > 2:
            raise McuError(f"a flash of {len(packed)} bytes: must be {words * (WORD + 1)}, as a board left it")
        bank.programmed[:], bank.content[:] = packed[:words], packed[words:]
        return bank


class FlashController:
    """The registers, and the bank behind them.

    Args:
        bank: is changed in place.
        changed: called with the offset of bytes that are not what they were, and how many.
        cut_at: the supply fails in this operation, counted from 1; 0 for never.
        seed: of what a torn word holds.

    Attributes:
        operations: so far, erased sectors and programmed words.
    """

    def __init__(self, bank: FlashBank, changed: Callable[[int, int], None], *, cut_at: int = 0, seed: int = 0) -> None:
        self.bank, self._changed, self._cut_at = bank, changed, cut_at
        self._random = random.Random(seed)
        self._keys, self._control, self._status, self._fault = 0, _LOCK, 0, 0
        self._buffer: dict[int, bytes] = {}
        self.operations = 0

    def read(self, offset: int) -> int:
        """A register of the bank's block."""
        known = {0x0C: self._control, 0x10: self._status | (_WBNE if self._buffer else 0), 0x60: self._fault}
        if offset not in known:
            raise McuError(f"flash controller: no register to read at {offset:#x}")
        return known[offset]

    def write(self, offset: int, value: int) -> None:
        """Raises PowerCut; McuError for a register or an operation that is not modelled."""
        if offset == 0x04:
            right = self._keys < len(_KEYS) and value == _KEYS[self._keys]
            # A wrong key locks the register until the next reset.
            self._keys = self._keys + 1 if right else len(_KEYS) + 1
            self._control &= ~_LOCK if self._keys == len(_KEYS) else ~0
        elif offset == 0x0C:
            if not self._control & _LOCK:
                self._control = value & ~_START
                self._keys = 0 if value & _LOCK else self._keys
                if value & _START and value & _SER:
                    self._erase(value >> 8 & 7)
                elif value & _START:
                    raise McuError(f"flash controller: CR2 {value:#x} is not modelled: sectors alone are erased")
        elif offset == 0x14:
            self._status &= ~(value & _ERRORS)
        else:
            raise McuError(f"flash controller: no register to write at {offset:#x}")

    def store(self, offset: int, data: bytes) -> None:
        """Four bytes into the bank, which fill the write buffer; raises PowerCut."""
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

    def is_bad(self, offset: int) -> bool:
        """Whether a read there finds an error."""
        return self.bank.programmed[offset // WORD] == 2

    def found_bad(self, offset: int) -> None:
        """A read there took place."""
        self._status |= _DBECCERR
        self._fault = offset // WORD

    def _erase(self, sector: int) -> None:
        is_cut = self._begins()
        left = self._random.randbytes(SECTOR) if is_cut else b"\xff" * SECTOR
        self._change(sector * SECTOR, left, bytes([2 if is_cut else 0]) * (SECTOR // WORD), is_cut=is_cut)

    def _program(self, at: int, data: bytes) -> None:
        is_cut, bank = self._begins(), self.bank
        if is_cut:
            data = bytes(byte | kept for byte, kept in zip(data, self._random.randbytes(WORD), strict=True))
        left = bytes(byte & old for byte, old in zip(data, bank.content[at : at + WORD], strict=True))
        self._change(at, left, b"\2" if is_cut or bank.programmed[at // WORD] else b"\1", is_cut=is_cut)

    def _begins(self) -> bool:
        """Whether the supply fails in this operation."""
        self.operations += 1
        return self.operations == self._cut_at

    def _change(self, at: int, content: bytes, programmed: bytes, *, is_cut: bool) -> None:
        self.bank.content[at : at + len(content)] = content
        self.bank.programmed[at // WORD : at // WORD + len(programmed)] = programmed
        self._changed(at, len(content))
        if is_cut:
            raise PowerCut
