"""The measurement of a library on an emulated Cortex-M7: time, memory, and a comparison with this host's results."""

import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from contract.controller.c_folder import ProgramRows, ProgramSettings, rows_from_text, rows_text
from contract.controller.interface import REFUSALS, TERMS
from contract.errors import McuError
from firmware_sim.mcu.build import COMMON, CORTEX_M7, Core, Firmware, compile_for_cortex_m7, compile_with_zig, read_elf
from firmware_sim.mcu.emulator import Machine

MCU_PHASES: Final = ("compile", "emulate", "run on this host", "count cycles")


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """The time and memory that a control step needs on the core when all iterations run. `ram_bytes` includes the
    stack. `multiply_accumulates` are products with weights, computed from the networks' sizes. Executed `instructions`
    are exact, and equal for all these steps; `cycles` are modelled (`firmware_sim.mcu.pipeline`). The times of a step,
    with one cycle per instruction and with `cycles`, are by clock rate in MHz. `identical` is whether all outputs of
    `steps` control steps equal the host's bit for bit; the differences are the largest of these steps."""

    precision: str
    program_sha256: str
    flash_bytes: int
    ram_bytes: int
    stack_bytes: int
    multiply_accumulates: int
    instructions: int
    cycles: int
    one_per_cycle_ms: dict[str, float]
    modelled_ms: dict[str, float]
    steps: int
    identical: bool
    action_difference: float
    cost_difference: float

    def rows(self) -> Iterator[tuple[str, str]]:
        """Yield a label and a figure with its unit for each row of a table."""
        yield "library", f"{self.precision}, {self.program_sha256[:12]}"
        for name, size in (("flash", self.flash_bytes), ("RAM with stack", self.ram_bytes)):
            yield name, f"{size / 1024:.1f} KiB"
        yield "stack", f"{self.stack_bytes} B"
        yield "multiply-accumulates", f"{self.multiply_accumulates / 1e6:.2f} M"
        yield "instructions", f"{self.instructions / 1e6:.3f} M"
        for clock, milliseconds in self.one_per_cycle_ms.items():
            yield f"at {clock} MHz, one instruction per cycle", f"{milliseconds:.1f} ms"
        for clock, milliseconds in self.modelled_ms.items():
            yield f"at {clock} MHz, modelled pipeline", f"{milliseconds:.1f} ms"
        agreement = "identical bit for bit" if self.identical else f"action within {self.action_difference:.2g}"
        yield f"{self.steps} steps against this host", agreement


def measure(
    sources: Mapping[str, bytes],
    rows: ProgramRows,
    *,
    core: Core = CORTEX_M7,
    phase: Callable[[str], None] = lambda begun: None,
) -> Measurement:
    """Compile a library, run it, and compare it with this host. `rows`, shape (n, S+1), has the pressures Cp at the S
    sensors and the action commanded one step before; n is at least the length of the window. `core` is compiled for and
    modelled; the emulated core is a Cortex-M7. `phase` is called with each of `MCU_PHASES`. Raises LibraryError if a
    setting is missing in the header; McuError if there are too few rows, or the library does not compile or run."""
    settings = ProgramSettings.of(sources)
    window, columns = settings.number("SW_WINDOW"), settings.number("SW_SENSORS") + 1
    if rows.ndim != 2 or rows.shape[1] != columns or len(rows) < window:
        raise McuError(f"the recorded rows have shape {rows.shape}; the core needs at least {window} rows of {columns}")
    phase(MCU_PHASES[0])
    firmware = read_elf(compile_for_cortex_m7(sources, core=core))
    machine = Machine(firmware)
    counter = machine.block_counter(core)
    phase(MCU_PHASES[1])
    found = _replay(machine, rows, window, settings.number("SW_HORIZON"))
    phase(MCU_PHASES[2])
    expected = _on_host(sources, rows)
    machine.paint_stack()
    machine.call("mcu_longest_step")
    stack = machine.stack_depth()
    phase(MCU_PHASES[3])
    counter.start()
    machine.call("mcu_longest_step")
    instructions, cycles = counter.total()
    return Measurement(
        precision=settings.text("SW_PRECISION"),
        program_sha256=settings.text("SW_PROGRAM_SHA256"),
        flash_bytes=flash_bytes(firmware),
        ram_bytes=linked_ram(firmware) + stack,
        stack_bytes=stack,
        multiply_accumulates=settings.multiply_accumulates(),
        instructions=instructions,
        cycles=cycles,
        one_per_cycle_ms={str(clock): instructions / (clock * 1e3) for clock in core.clocks_mhz},
        modelled_ms={str(clock): cycles / (clock * 1e3) for clock in core.clocks_mhz},
        steps=len(found),
        identical=bool(np.array_equal(found, expected)),
        action_difference=float(np.abs(found[:, 0] - expected[:, 0]).max()),
        cost_difference=float(np.abs(found[:, 1] - expected[:, 1]).max()),
    )


def flash_bytes(firmware: Firmware) -> int:
    """Return the number of bytes of flash for code and data, including initial values that are copied to RAM."""
    return sum(firmware.sections.get(name, 0) for name in (".vectors", ".text", ".hot", ".rodata", ".data"))


def linked_ram(firmware: Firmware) -> int:
    """Return the number of bytes of RAM without the stack."""
    return sum(firmware.sections.get(name, 0) for name in (".hot", ".data", ".bss"))


def _replay(machine: Machine, rows: ProgramRows, window: int, horizon: int) -> ProgramRows:
    """Return the action and the cost for every row from the first full window on."""
    machine.call("mcu_reset")
    answers = []
    for i, row in enumerate(rows, start=1):
        machine.write("mcu_row", row.astype("<f4").tobytes())
        # Like the example program on the host, this loop records no outputs before the window is full.
        if (status := machine.call("mcu_step" if i >= window else "mcu_push")) != 0:
            raise McuError(f"row {i}: {REFUSALS[status]}")
        if i >= window:
            output = np.frombuffer(machine.read("mcu_output", 4 * (3 * horizon + len(TERMS) + 1)), dtype="<f4")
            answers.append((output[0], output[-1]))
    return np.array(answers, dtype=np.float32)


def _on_host(sources: Mapping[str, bytes], rows: ProgramRows) -> ProgramRows:
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder, "replay")
        compile_with_zig(sources, program, (*COMMON, "-march=native"))
        done = subprocess.run([program], input=rows_text(rows), capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise McuError(f"the example program failed on the host: {done.stderr.strip()}")
    return rows_from_text(done.stdout)[:, [0, 3]]


def verdicts(modelled_ms: Mapping[str, float], period: float) -> Iterator[tuple[str, str]]:
    """Yield (label, text) for users: the control period in ms, and a verdict on each `Measurement.modelled_ms`."""
    yield "control period", f"{period:g} ms (from the settings; it is not in the library)"
    for clock, needed in modelled_ms.items():
        share = needed / period
        fits, exceeds = f"fits: {100.0 * share:.0f} % of the period", f"DOES NOT FIT: {share:.1f} times the period"
        yield f"at {clock} MHz, by the model", fits if share <= 1.0 else exceeds
