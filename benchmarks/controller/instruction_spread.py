"""A test of whether the work of a control step depends on its data: the instructions for many windows are counted on
the emulated core."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from contract.arrays import Array
from contract.errors import McuError
from firmware_sim.mcu.build import compile_for_cortex_m7
from firmware_sim.mcu.elf import read_elf
from firmware_sim.mcu.emulator import Machine


@dataclass(frozen=True, kw_only=True)
class InstructionSpread:
    """The numbers of instructions of a control step for many windows.

    Attributes:
        windows: number of windows.
        fewest, most: smallest and largest number of instructions, including conditional instructions that are skipped.
        unlike: number of windows whose number of instructions differs from the most frequent number.
    """

    windows: int
    fewest: int
    most: int
    unlike: int


def instruction_spread(sources: Mapping[str, bytes], windows: Iterable[Array]) -> InstructionSpread:
    """Run a control step for each window; each step starts with the plan of the previous step. Raises McuError if the
    library does not compile or run, or there are no windows.

    Args:
        sources: files of the library by name.
        windows: windows of L rows with S sensors and the action, each of shape (L, S+1).
    """
    machine = Machine(read_elf(compile_for_cortex_m7(sources)))
    counter = machine.block_counter()
    machine.call("mcu_reset")
    counts = []
    for number, window in enumerate(windows, start=1):
        # The window is written without its newest row, because the step itself appends this row.
        machine.write("mcu_input", np.concatenate([window[:1], window[:-1]]).astype("<f4").tobytes())
        machine.write("mcu_row", window[-1].astype("<f4").tobytes())
        counter.start()
        if machine.call("mcu_step") != 0:
            raise McuError(f"window {number}: a number is not finite")
        counts.append(counter.total()[0])
    if not counts:
        raise McuError("no windows to run")
    values, often = np.unique(counts, return_counts=True)
    return InstructionSpread(
        windows=len(counts),
        fewest=int(values.min()),
        most=int(values.max()),
        unlike=int(len(counts) - often.max()),
    )
