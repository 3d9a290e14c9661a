"""The board: a core with its memories and registers, from power-on to power-off, in virtual time.

The firmware runs from its reset vector until it sleeps (`wfi`); then the caller advances the board's time. No interrupt
handler runs: the firmware masks interrupts, and a pending interrupt only ends its sleep. A `Board` exists for one power
cycle; the next `Board` gets the contents of its flash. The memory map is as in an STM32H743, with the registers of
`flash_controller`, `can_controller` and `small_parts`.
"""

import struct
from collections.abc import Callable
from typing import Any, Final

from unicorn import arm_const, unicorn_const

from contract.errors import McuError
from firmware_sim.mcu.board.can_controller import CanController
from firmware_sim.mcu.board.flash_controller import (
    SECTOR,
    SECTORS,
    STM32H743,
    WORD,
    FlashBank,
    FlashController,
    FlashTimes,
    PowerCut,
)
from firmware_sim.mcu.board.small_parts import CPACR, CoreRegisters, Counter, RandomNumbers, StampTimer, SystemReset
from firmware_sim.mcu.build import Firmware
from firmware_sim.mcu.emulator import FLASH, EmulatedCore

BANK: Final = 0x0810_0000
BANK_BYTES: Final = SECTOR * SECTORS
DTCM, DTCM_BYTES = 0x2000_0000, 128 * 1024
SRAM, SRAM_BYTES = 0x2400_0000, 512 * 1024
BACKUP, BACKUP_BYTES = 0x3880_0000, 4096
"""Address and size in bytes of the battery-supplied SRAM, whose contents survive a power cycle."""
_STACK_BYTES: Final = 16 * 1024
_PAGE: Final = 4096
_COUNTER, _RANDOM, _CAN, _FLASH, _CORE = 0x5C00_8000, 0x4802_1800, 0x4000_A000, 0x5200_2100, 0xE000_E000
_STAMPS: Final = 0x4000_0400
_READABLE: Final = unicorn_const.UC_PROT_READ
_LONGEST_US: Final = 600_000_000  # wall-clock time in us after which a core that is not asleep counts as failed
Part = Counter | RandomNumbers | StampTimer | CanController | FlashController | CoreRegisters


class Board(EmulatedCore):
    """A board that has been switched on; `run` executes the firmware in the first bank of flash. The second bank is
    changed in place; None is an erased bank. The counter starts at `now_ns`. The supply fails in the flash operation
    number `cut_at`, counted from 1; 0 means no failure. `seed` is for the random numbers and for the contents of a
    partly programmed word. The battery-supplied SRAM starts with the contents `backup`."""

    def __init__(
        self,
        firmware: Firmware,
        bank: FlashBank | None = None,
        *,
        now_ns: int = 0,
        times: FlashTimes = STM32H743,
        cut_at: int = 0,
        seed: int = 0,
        backup: bytes = b"",
    ) -> None:
        memories = ((DTCM, DTCM_BYTES), (SRAM, SRAM_BYTES), (BACKUP, BACKUP_BYTES))
        super().__init__(firmware, memories, (DTCM, _STACK_BYTES))
        self.poke(BACKUP, backup)
        self._raised = list[Exception]()
        self.counter, self._registers, self.random = Counter(now_ns), CoreRegisters(), RandomNumbers(seed)
        stamps = StampTimer(lambda: self.counter.now_ns)
        self.can = CanController(lambda: self.counter.now_ns, stamps.count)
        self.flash = FlashController(
            bank or FlashBank(), self._flash_changed, counter=self.counter, times=times, cut_at=cut_at, seed=seed
        )
        self._bad_pages, self._bad_wanted = set[int](), set[int]()
        self._rights = _READABLE
        for page in range(0, BANK_BYTES, _PAGE):
            self._core.mem_map(BANK + page, _PAGE, _READABLE)
        self._flash_changed(0, BANK_BYTES)
        self._exchange_pages()
        parts: dict[int, Part] = {_COUNTER: self.counter, _RANDOM: self.random, _STAMPS: stamps, _CAN: self.can}
        parts |= {_FLASH: self.flash, _CORE: self._registers}
        for base, part in parts.items():
            size = 0x4000 if part is self.can else 0x1000
            self._core.mmio_map(base & -_PAGE, size, *self._registers_of(part, base & _PAGE - 1))
        self._core.hook_add(unicorn_const.UC_HOOK_MEM_WRITE_PROT, self._stored)
        self._core.hook_add(unicorn_const.UC_HOOK_MEM_READ_PROT, self._read_amid)
        self.blocks = self.block_counter()
        stack, self._at = struct.unpack("<II", self.peek(FLASH, 8))
        self._core.reg_write(arm_const.UC_ARM_REG_SP, stack)

    def run(self) -> None:
        """Execute the firmware until it sleeps. Raises McuError if the core stopped, used a register that is not
        modelled, or does not sleep; PowerCut or SystemReset if the power cycle has ended."""
        self._exchange_pages()
        self._execute("firmware", self._at, 0xFFFF_FFFE, _LONGEST_US)
        self._at = int(self._core.reg_read(arm_const.UC_ARM_REG_PC))
        if self._core.mem_read(self._at - 2, 2) != b"\x30\xbf":
            raise McuError(f"the core did not sleep within {_LONGEST_US // 10**6} s; it is at {self._at:#x}")

    def _execute(self, what: str, start: int, end: int, longest_us: int = 0) -> None:
        try:
            super()._execute(what, start, end, longest_us)
        except McuError:
            if not self._raised:
                raise
        if self._raised:
            raise self._raised.pop()

    def _guarded(self, work: Callable[[], object]) -> int:
        """Call `work`, which accesses a register. Its exception stops the emulation, and `_execute` raises it again."""
        if self._raised:
            # The core executes a few more instructions before it stops; these instructions must have no effect.
            return 0
        try:
            shown = work()
            return shown if isinstance(shown, int) else 0
        except (McuError, PowerCut, SystemReset) as error:
            self._raised.append(error)
            self._core.emu_stop()
            return 0

    def _registers_of(self, part: Part, shift: int) -> tuple[Any, ...]:
        """Return Unicorn's callbacks for a part's page, in which the part's registers begin at offset `shift`."""

        def read(_core: Any, offset: int, size: int, _data: Any) -> int:
            if part is self.flash:
                self._exchange_pages()
            return self._guarded(lambda: part.read(_whole(offset, size) - shift))

        def write(_core: Any, offset: int, size: int, value: int, _data: Any) -> None:
            self._guarded(lambda: part.write(_whole(offset, size) - shift, value & 0xFFFF_FFFF))
            # During a flash operation the bank is protected against reads, so that each read calls `_read_amid`.
            if part is self.flash and self.flash.is_at_work:
                self._protect(unicorn_const.UC_PROT_NONE)
            if part is self._registers and offset == CPACR and self._registers.has_floats:
                self._core.reg_write(arm_const.UC_ARM_REG_FPEXC, 0x4000_0000)

        return read, None, write, None

    def _stored(self, _core: Any, _access: int, address: int, size: int, value: int, _data: Any) -> bool:
        data = (value & (1 << 8 * size) - 1).to_bytes(size, "little")
        self._guarded(lambda: self.flash.store(address - BANK, data))
        return True

    def _loaded(self, offset: int, size: int) -> int:
        """Return what the core reads at `offset`, in a page with unreadable words."""
        self.flash.stall()
        is_masked = self._registers.ignores_bus_faults and self._core.reg_read(arm_const.UC_ARM_REG_FAULTMASK)
        if self.flash.finds_bad(offset) and not is_masked:
            raise McuError(f"bus fault: the flash word at {BANK + offset:#x} is unreadable")
        return int.from_bytes(self.flash.bank.content[offset : offset + size], "little")

    def _flash_changed(self, offset: int, size: int) -> None:
        bank, words = self.flash.bank, _PAGE // WORD
        for page in range(offset // _PAGE * _PAGE, offset + size, _PAGE):
            is_bad = 2 in bank.programmed[page // WORD : page // WORD + words]
            (self._bad_wanted.add if is_bad else self._bad_wanted.discard)(page)
            if page not in self._bad_pages:
                self._core.mem_write(BANK + page, bytes(bank.content[page : page + _PAGE]))

    def _exchange_pages(self) -> None:
        """Map pages with unreadable words to functions of this class, and all other pages to memory. During a flash
        operation, do nothing. Hooks on every read would slow down the emulator."""
        if self.flash.is_at_work:
            return
        self._protect(_READABLE)
        for page in self._bad_wanted ^ self._bad_pages:
            self._core.mem_unmap(BANK + page, _PAGE)
            if page in self._bad_pages:
                self._core.mem_map(BANK + page, _PAGE, _READABLE)
                self._core.mem_write(BANK + page, bytes(self.flash.bank.content[page : page + _PAGE]))
            else:
                self._core.mmio_map(BANK + page, _PAGE, *self._bad_page(page))
        self._bad_pages = set(self._bad_wanted)

    def _protect(self, rights: int) -> None:
        """Set the core's rights of access to those pages of the bank that have no unreadable words."""
        if rights != self._rights:
            self._rights = rights
            for page in range(BANK, BANK + BANK_BYTES, _PAGE):
                if page - BANK not in self._bad_pages:
                    self._core.mem_protect(page, _PAGE, rights)

    def _read_amid(self, *_access: Any) -> bool:
        self.flash.stall()
        self._protect(_READABLE)
        return True

    def _bad_page(self, page: int) -> tuple[Any, ...]:
        def read(_core: Any, offset: int, size: int, _data: Any) -> int:
            return self._guarded(lambda: self._loaded(page + offset, size))

        def write(core: Any, offset: int, size: int, value: int, _data: Any) -> None:
            self._stored(core, 0, BANK + page + offset, size, value, None)

        return read, None, write, None


def _whole(offset: int, size: int) -> int:
    """Return the offset of a register; raises McuError unless the access covers exactly one register."""
    if size != 4 or offset % 4:
        raise McuError(f"a register is accessed with {size} bytes at {offset:#x}; an access must be 4 aligned bytes")
    return offset
