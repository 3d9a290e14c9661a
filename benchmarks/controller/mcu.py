"""Memory, instructions and modelled time on an emulated Cortex-M7: the C library with networks of several sizes, and
the release's ECU.

    python -m benchmarks mcu [--json FILE]

The row `release` is the whole ECU of the shipped bundle in the drives of `worst_period`, without and with a key of the
bus. Its control step is also run for many windows, to test whether its work depends on the data. The other rows have
random weights, because the work depends only on the sizes. Libraries for the Cortex-M4F run on the emulated Cortex-M7,
which has all of the Cortex-M4F's instructions, but their cycles are modelled with the Cortex-M4F's pipeline.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from typing import Any, Final

import numpy as np

from benchmarks.common.command_line import JsonFile, report, track
from benchmarks.controller import tables
from benchmarks.controller.worst_period import worst_periods
from contract.arrays import Array
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.config.loading import load_config
from contract.controller.c_folder import ECU_SETTINGS, read_recorded, read_sources
from contract.errors import McuError
from contract.model import model_folder
from contract.recording import dataset
from contract.release.bundle import load as load_bundle
from contract.results import versions
from contract.shipped import BUNDLE, MODEL, RECORDING
from ecu.in_c.c_settings import ecu_settings
from examples.random_programs import random_program
from export.program.controller_program import program_of, random_windows, recorded_windows
from export.to_c.library import c_library, int8_library
from firmware_sim.mcu.build import CORTEX_M4F, CORTEX_M7, Core, compile_for_cortex_m7, read_elf
from firmware_sim.mcu.emulator import Machine
from firmware_sim.mcu.measure import measure
from stillwake.parts.c_release import library_folder

Case = tuple[int, int, int, str]
"""The dynamics' width, the decoder's width, the number of iterations, and the precision."""
SMALLER: Final[tuple[Case, ...]] = ((96, 64, 3, "int8"), (64, 32, 5, "int8"), (64, 32, 3, "int8"))
"""Cases that are also measured for the Cortex-M4F."""
CASES: Final[tuple[Case, ...]] = (
    *((256, 128, 5, "float32"), (256, 128, 5, "int8"), (128, 64, 5, "int8"), (128, 64, 3, "int8")),
    *((96, 64, 5, "int8"), *SMALLER),
)


def main(json_file: JsonFile = None) -> None:
    """Measure the networks of every size and the release, and print a table."""
    rows = [_measured(case, CORTEX_M7) for case in track(CASES, "sizes on a Cortex-M7", "sizes")]
    smaller = [_measured(case, CORTEX_M4F) for case in track(SMALLER, "sizes on a Cortex-M4F", "sizes")]
    facts = {"horizon": MpcConfig().horizon, "versions": versions("ziglang", "unicorn", "capstone")}
    figures = {"release": _release(), "sizes": rows, "cortex_m4f": smaller}
    report(json_file, figures, facts, tables.mcu, tables.mcu_release)


def _measured(case: Case, core: Core) -> dict[str, Any]:
    dynamics, decoder, iterations, precision = case
    widths = {"dynamics_width": dynamics, "decoder_width": decoder}
    program = random_program(0, model=ModelConfig(**widths), mpc=MpcConfig(iterations=iterations))
    windows = random_windows(program, 20)
    sources = c_library(program) if precision == "float32" else int8_library(program, windows)
    series = np.concatenate(windows[:2])[: program.window + 3].astype(np.float32)  # four steps
    return {**widths, "iterations": iterations, **asdict(measure(sources, series, core=core))}


def _release() -> dict[str, Any]:
    config, bundle = load_config(), load_bundle(BUNDLE)
    with library_folder(None) as folder:
        sources, rows = read_sources(folder, board=True), read_recorded(folder)
    spread = instruction_spread(sources, track(_windows(200), "windows of the release", "windows"))
    keyed = replace(config, bus=replace(config.bus, key="bus.key"))
    secured = {**sources, ECU_SETTINGS: ecu_settings(bundle, keyed)}
    return {
        **worst_periods(sources, config, rows),
        "secured": worst_periods(secured, keyed, rows, drives=("full bus",)),
        "control_step": spread,
        "bundle": bundle.manifest.name,
    }


def instruction_spread(sources: Mapping[str, bytes], windows: Iterable[Array]) -> dict[str, int]:
    """Run a control step for each window, shape (L, S+1), with the plan of the previous step. Return the number of
    windows, the fewest and the most instructions, also skipped ones, and the number of windows that do not take the
    most frequent number. Raises McuError if the library does not compile or run, or there are no windows."""
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
    alike = max(map(counts.count, counts))
    return {"windows": len(counts), "fewest": min(counts), "most": max(counts), "unlike": len(counts) - alike}


def _windows(count: int) -> list[Array]:
    """Return `count` windows. Half of them are evenly spaced over the recording's episodes; the others are random."""
    program, data, found = (
        program_of(model_folder.read(MODEL), load_config().mpc),
        dataset.read(RECORDING),
        list[Array](),
    )
    share = -(-count // (2 * len(data.episodes)))
    for item in data.episodes:
        found += recorded_windows(program, item, len(item) - program.window, data.layout)[:: len(item) // share]
    return found[: count // 2] + random_windows(program, count - len(found[: count // 2]))
