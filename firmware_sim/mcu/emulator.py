"""A Cortex-M7 in Unicorn: access to memories, calls of functions, counts of executed blocks, and the stack depth."""

import ctypes
import tempfile
from collections.abc import Iterator, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
import unicorn
from unicorn import arm_const, unicorn_const
from unicorn.unicorn_py3 import unicorn as bindings

from contract.errors import McuError
from contract.runtime.copies import NeverCopied
from firmware_sim.mcu.build import CORTEX_M7, Core, Firmware, compile_with_zig
from firmware_sim.mcu.pipeline import Pipeline

FLASH: Final = 0x0800_0000
FLASH_BYTES: Final = 1 << 20
RAM: Final = 0x2000_0000
_RAM_BYTES: Final = 1 << 19
_STACK_BYTES: Final = 8192
_STACK: Final = 0x3000_0000
_UNTOUCHED: Final = 0xA5
_RETURN: Final = FLASH + FLASH_BYTES - 0x100


class _BlockCounts(ctypes.Structure):
    _fields_ = (
        ("origin", ctypes.c_uint64),
        ("places", ctypes.c_uint64),
        ("counts", ctypes.c_void_p),
        ("sizes", ctypes.c_void_p),
    )


@cache
def _library() -> ctypes.CDLL:
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder, "block_counter.so")
        source = files("firmware_sim").joinpath("mcu/c_host/block_counter.c").read_bytes()
        compile_with_zig({"block_counter.c": source}, library, ("-O2", "-fPIC", "-shared"))
        return ctypes.CDLL(str(library))


class BlockCounter:
    """A counter of the basic blocks that run in the flash. Its hook is in C: a hook in Python would take a hundred
    times as long as the emulation. Create the counter before the core first runs, because the hook is not called for
    code that Unicorn translated earlier. Raises McuError if there is no compiler, or Unicorn refuses the hook."""

    def __init__(self, core: Any, pipeline: Pipeline) -> None:
        places = FLASH_BYTES // 2
        self._counts = np.zeros(places, dtype=np.uint64)
        self._sizes = np.zeros(places, dtype=np.uint32)
        self._modelled = cache(pipeline.block)
        self._arguments = _BlockCounts(FLASH, places, self._counts.ctypes.data, self._sizes.ctypes.data)
        handle, arguments = ctypes.byref(ctypes.c_size_t()), ctypes.byref(self._arguments)
        count = ctypes.cast(_library().count_block, ctypes.c_void_p)
        anywhere = ctypes.c_uint64(1), ctypes.c_uint64(0)
        add: Any = bindings.uclib.uc_hook_add
        failed = add(core._uch, handle, unicorn_const.UC_HOOK_BLOCK, count, arguments, *anywhere)
        if failed:
            raise McuError(f"the emulator refused a hook: Unicorn's error code {failed}")

    def start(self) -> None:
        """Set the counts to zero."""
        self._counts[:] = 0

    def total(self) -> tuple[int, int]:
        """Return the number of instructions and the modelled cycles since `start`."""
        blocks = list(self.blocks())
        return sum(instructions for _, instructions, _ in blocks), sum(cycles for _, _, cycles in blocks)

    def blocks(self) -> Iterator[tuple[int, int, int]]:
        """Yield (address, instructions, modelled cycles) of each block that ran since `start`, summed over its runs."""
        places = np.flatnonzero(self._counts)
        found = zip(places.tolist(), self._counts[places].tolist(), self._sizes[places].tolist(), strict=True)
        for place, count, size in found:
            instructions, cycles = self._modelled(FLASH + 2 * place, size)
            yield FLASH + 2 * place, count * instructions, count * cycles


class EmulatedCore(NeverCopied):
    """A core with a program in its flash; the program has not started to run. `memories` has the address and size in
    bytes of each writable memory, `stack` those of the stack, which is at the lowest address of one of the memories."""

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
        """Run a function of the firmware until it returns; return its result. Raises McuError if the core stops."""
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
        """Return a counter of the basic blocks that run from now on. Create it before the core first runs."""
        code = self.peek(FLASH, FLASH_BYTES)
        return BlockCounter(self._core, Pipeline(code, FLASH, dual_issue=core.dual_issue))

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
