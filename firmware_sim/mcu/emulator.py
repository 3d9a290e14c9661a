"""A Cortex-M7 under Unicorn: memories, calls of functions, and the deepest stack."""

import struct
from typing import Any, Final

import unicorn
from unicorn import arm_const, unicorn_const

from contract.errors import McuError
from firmware_sim.mcu.block_counter import BlockCounter
from firmware_sim.mcu.cores import CORTEX_M7, Core
from firmware_sim.mcu.elf import Firmware
from firmware_sim.mcu.pipeline import Pipeline

FLASH: Final = 0x0800_0000
FLASH_BYTES: Final = 1 << 20
RAM: Final = 0x2000_0000
RAM_BYTES: Final = 1 << 19
STACK_BYTES: Final = 8192
MESSAGES: Final = 0x4000_A000
"""Where the CAN controller keeps received frames."""
MESSAGES_BYTES: Final = 1 << 16
_STACK: Final = 0x3000_0000
_UNTOUCHED: Final = 0xA5
_RETURN: Final = FLASH + FLASH_BYTES - 0x100
# The Cortex-M system control space, and in it the coprocessor access register that switches the floating-point unit on.
_SYSTEM: Final = 0xE000_E000
_COPROCESSORS: Final = 0xE000_ED88


class Machine:
    """A core with a firmware in its flash. The stack is a memory of its own, so that an overflow is seen."""

    def __init__(self, firmware: Firmware) -> None:
        self._symbols = firmware.symbols
        # The bindings carry annotations on some functions only.
        binding: Any = unicorn
        mode = unicorn_const.UC_MODE_THUMB | unicorn_const.UC_MODE_MCLASS
        self._failure: Any = binding.UcError
        self._core: Any = binding.Uc(unicorn_const.UC_ARCH_ARM, mode)
        self._core.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M7)
        for start, size in (
            (FLASH, FLASH_BYTES),
            (RAM, RAM_BYTES),
            (_STACK, STACK_BYTES),
            (_SYSTEM, 0x1000),
            (MESSAGES, MESSAGES_BYTES),
        ):
            self._core.mem_map(start, size)
        for segment in firmware.segments:
            self._core.mem_write(segment.address, segment.content)
        self._core.reg_write(arm_const.UC_ARM_REG_FPEXC, 0x4000_0000)
        self._core.mem_write(_COPROCESSORS, struct.pack("<I", 0xF << 20))

    def write(self, symbol: str, content: bytes) -> None:
        """Put bytes where a symbol is."""
        self._core.mem_write(self._address(symbol), content)

    def write_at(self, address: int, content: bytes) -> None:
        """Put bytes at an address."""
        self._core.mem_write(address, content)

    def block_counter(self, core: Core = CORTEX_M7) -> BlockCounter:
        """A counter of the basic blocks that run from now on; made before the first call."""
        return BlockCounter(self._core, FLASH, FLASH_BYTES, Pipeline(self.code(), FLASH, dual_issue=core.dual_issue))

    def read(self, symbol: str, size: int) -> bytes:
        """Bytes from where a symbol is."""
        return bytes(self._core.mem_read(self._address(symbol), size))

    def call(self, function: str) -> int:
        """Run a function without arguments to its return; its result. Raises McuError if it does something that the
        machine cannot, such as leaving its memories."""
        self._core.reg_write(arm_const.UC_ARM_REG_SP, _STACK + STACK_BYTES)
        self._core.reg_write(arm_const.UC_ARM_REG_LR, _RETURN | 1)
        try:
            self._core.emu_start(self._address(function) | 1, _RETURN)
        except self._failure as error:
            at = self._core.reg_read(arm_const.UC_ARM_REG_PC)
            raise McuError(f"{function}: the core stopped at {at:#x} ({error})") from error
        return int(self._core.reg_read(arm_const.UC_ARM_REG_R0))

    def stack_used(self, function: str) -> int:
        """Bytes of stack that a call of the function touches."""
        self.paint_stack()
        self.call(function)
        return self.stack_depth()

    def paint_stack(self) -> None:
        """Mark all of the stack as untouched."""
        self._core.mem_write(_STACK, bytes([_UNTOUCHED]) * STACK_BYTES)

    def stack_depth(self) -> int:
        """Bytes of stack touched since `paint_stack`."""
        stack = bytes(self._core.mem_read(_STACK, STACK_BYTES))
        return STACK_BYTES - next((i for i, byte in enumerate(stack) if byte != _UNTOUCHED), STACK_BYTES)

    def code(self) -> bytes:
        """All of the flash."""
        return bytes(self._core.mem_read(FLASH, FLASH_BYTES))

    def _address(self, symbol: str) -> int:
        if symbol not in self._symbols:
            raise McuError(f"the firmware has no symbol {symbol}")
        return self._symbols[symbol]
