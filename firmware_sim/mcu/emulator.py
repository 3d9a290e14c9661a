"""A Cortex-M7 in Unicorn: access to memories, calls of functions, counts of executed blocks, and the stack depth."""

from collections.abc import Sequence
from typing import Any, ClassVar, Final

import unicorn
from unicorn import arm_const, unicorn_const

from contract.errors import McuError
from contract.runtime.copies import NeverCopied
from firmware_sim.mcu.block_counter import BlockCounter
from firmware_sim.mcu.cores import CORTEX_M7, Core
from firmware_sim.mcu.elf import Firmware
from firmware_sim.mcu.pipeline import Pipeline

FLASH: Final = 0x0800_0000
FLASH_BYTES: Final = 1 << 20
RAM: Final = 0x2000_0000
_RAM_BYTES: Final = 1 << 19
_STACK_BYTES: Final = 8192
_STACK: Final = 0x3000_0000
_UNTOUCHED: Final = 0xA5
_RETURN: Final = FLASH + FLASH_BYTES - 0x100


class EmulatedCore(NeverCopied):
    """A core with a program in its flash; the program has not started to run.

    Args:
        memories: address and size in bytes of each writable memory.
        stack: address and size in bytes of the stack, which starts at the lowest address of one of the memories.
    """

    INSTEAD: ClassVar = "its state is in the emulator's memory; create another emulator of the same firmware"

    def __init__(self, firmware: Firmware, memories: Sequence[tuple[int, int]], stack: tuple[int, int]) -> None:
        self._symbols, self._stack = firmware.symbols, stack
        # The type is Any because only some functions of Unicorn's binding have type annotations.
        binding: Any = unicorn
        mode = unicorn_const.UC_MODE_THUMB | unicorn_const.UC_MODE_MCLASS
        self._failure: Any = binding.UcError
        self._core: Any = binding.Uc(unicorn_const.UC_ARCH_ARM, mode)
        self._core.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M7)
        for start, size in ((FLASH, FLASH_BYTES), *memories):
            self._core.mem_map(start, size)
        for address, content in firmware.segments:
            self._core.mem_write(address, content)
        self.paint_stack()

    def symbol(self, name: str) -> int:
        """Return the address of a symbol; raises McuError if the firmware has no symbol of this name."""
        if name not in self._symbols:
            raise McuError(f"the firmware has no symbol {name}")
        return self._symbols[name]

    def peek(self, address: int, size: int) -> bytes:
        return bytes(self._core.mem_read(address, size))

    def poke(self, address: int, content: bytes) -> None:
        self._core.mem_write(address, content)

    def call(self, function: str, *arguments: int) -> int:
        """Run a function to its return, as a debugger does; return its result. Raises McuError if the core stops."""
        kept = self._core.context_save()
        for number, value in enumerate(arguments):
            self._core.reg_write(arm_const.UC_ARM_REG_R0 + number, value)
        self._core.reg_write(arm_const.UC_ARM_REG_LR, _RETURN | 1)
        try:
            self._execute(function, self.symbol(function), _RETURN)
            return int(self._core.reg_read(arm_const.UC_ARM_REG_R0))
        finally:
            self._core.context_restore(kept)

    def block_counter(self, core: Core = CORTEX_M7) -> BlockCounter:
        """Return a counter of the basic blocks that run from now on. Call this before the first block runs."""
        code = self.peek(FLASH, FLASH_BYTES)
        return BlockCounter(self._core, FLASH, FLASH_BYTES, Pipeline(code, FLASH, dual_issue=core.dual_issue))

    def paint_stack(self) -> None:
        """Fill the stack with a pattern that marks it as untouched."""
        self.poke(self._stack[0], bytes([_UNTOUCHED]) * self._stack[1])

    def stack_depth(self) -> int:
        """Return the number of bytes of the stack that were touched since `paint_stack`."""
        stack = self.peek(*self._stack)
        return len(stack) - next((i for i, byte in enumerate(stack) if byte != _UNTOUCHED), len(stack))

    def _execute(self, what: str, start: int, end: int, longest_us: int = 0) -> None:
        try:
            self._core.emu_start(start | 1, end, timeout=longest_us)
        except self._failure as error:
            at = self._core.reg_read(arm_const.UC_ARM_REG_PC)
            raise McuError(f"{what}: the core stopped at {at:#x} ({error})") from error


class Machine(EmulatedCore):
    """A core whose functions are called one by one. The stack is a separate memory, so its overflow is detected."""

    def __init__(self, firmware: Firmware) -> None:
        stack = (_STACK, _STACK_BYTES)
        super().__init__(firmware, ((RAM, _RAM_BYTES), stack), stack)
        self._core.reg_write(arm_const.UC_ARM_REG_FPEXC, 0x4000_0000)
        self._core.reg_write(arm_const.UC_ARM_REG_SP, _STACK + _STACK_BYTES)

    def write(self, symbol: str, content: bytes) -> None:
        self.poke(self.symbol(symbol), content)

    def read(self, symbol: str, size: int) -> bytes:
        return self.peek(self.symbol(symbol), size)

    def stack_used(self, function: str) -> int:
        """Call a function and return the number of bytes of the stack that the call touches."""
        self.paint_stack()
        self.call(function)
        return self.stack_depth()
