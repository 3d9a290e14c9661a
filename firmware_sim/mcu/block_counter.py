"""A counter of how often each basic block of a firmware runs, implemented as a hook in machine code.

A hook in Python would take a hundred times as long as the emulation itself.
"""

import ctypes
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from unicorn import unicorn_const
from unicorn.unicorn_py3 import unicorn as bindings

from contract.errors import McuError
from firmware_sim.mcu.build import compile_block_counter
from firmware_sim.mcu.pipeline import Pipeline


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
        compile_block_counter(library)
        return ctypes.CDLL(str(library))


class BlockCounter:
    """A counter of the basic blocks that run in the memory of `size` bytes at `origin`. Create it before the core first
    runs, because a hook does not see code that Unicorn translated earlier. Raises McuError if there is no compiler for
    the hook, or Unicorn does not accept the hook."""

    def __init__(self, core: Any, origin: int, size: int, pipeline: Pipeline) -> None:
        self._origin, self._pipeline = origin, pipeline
        self._counts = np.zeros(size // 2, dtype=np.uint64)
        self._sizes = np.zeros(size // 2, dtype=np.uint32)
        self._modelled: dict[tuple[int, int], tuple[int, int]] = {}
        self._arguments = _BlockCounts(origin, size // 2, self._counts.ctypes.data, self._sizes.ctypes.data)
        handle = ctypes.c_size_t()
        library_call: Any = bindings.uclib.uc_hook_add
        failed = library_call(
            core._uch,
            ctypes.byref(handle),
            unicorn_const.UC_HOOK_BLOCK,
            ctypes.cast(_library().count_block, ctypes.c_void_p),
            ctypes.byref(self._arguments),
            ctypes.c_uint64(1),
            ctypes.c_uint64(0),
        )
        if failed:
            raise McuError(f"the emulator refused a hook: unicorn's error {failed}")

    def start(self) -> None:
        """Set the counts to zero."""
        self._counts[:] = 0

    def total(self) -> tuple[int, int]:
        """Return the number of instructions and the modelled cycles since `start`."""
        blocks = list(self.blocks())
        return sum(instructions for _, instructions, _ in blocks), sum(cycles for _, _, cycles in blocks)

    def blocks(self) -> Iterator[tuple[int, int, int]]:
        """Yield each block that ran since `start`: address, and instructions and modelled cycles of all its runs."""
        places = np.flatnonzero(self._counts)
        found = zip(places.tolist(), self._counts[places].tolist(), self._sizes[places].tolist(), strict=True)
        for place, count, size in found:
            block = place, size
            if block not in self._modelled:
                self._modelled[block] = self._pipeline.block(self._origin + 2 * place, size)
            instructions, cycles = self._modelled[block]
            yield self._origin + 2 * place, count * instructions, count * cycles
