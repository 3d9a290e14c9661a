"""The C library on an emulated Cortex-M7 at several sizes: memory, instructions, modelled time.

    python -m benchmarks mcu [--json FILE]

Weights are random (the work depends on the sizes); `stillwake mcu FOLDER` measures a trained library.
"""

from dataclasses import asdict
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.common.command_line import JsonFile, console, save, track
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.results import versions
from export.program.random_program import random_program, random_window
from export.release.lowering import int8_library
from export.to_c.library import c_library
from firmware_sim.mcu.measure import measure

# Dynamics' width, decoder's width, iterations, precision.
CASES = (
    (256, 128, 5, "float32"),
    (256, 128, 5, "int8"),
    (128, 64, 5, "int8"),
    (128, 64, 3, "int8"),
    (96, 64, 5, "int8"),
    (64, 32, 5, "int8"),
)
_ROWS = 4


def main(json_file: JsonFile = None) -> None:
    """Measure every size and print a table."""
    rows = []
    for dynamics, decoder, iterations, precision in track(CASES, "sizes", "sizes"):
        model = ModelConfig(dynamics_width=dynamics, decoder_width=decoder)
        program = random_program(0, model=model, mpc=MpcConfig(iterations=iterations))
        rng = np.random.default_rng(0)
        windows = [random_window(program, rng) for _ in range(20)]
        sources = c_library(program) if precision == "float32" else int8_library(program, windows)
        series = np.concatenate(windows[:2])[: program.window + _ROWS - 1].astype(np.float32)
        sizes = {"dynamics_width": dynamics, "decoder_width": decoder, "iterations": iterations}
        rows.append({**sizes, **asdict(measure(sources, series))})
    _print(rows)
    facts = {"horizon": MpcConfig().horizon, "versions": versions("ziglang", "unicorn", "capstone")}
    save(json_file, figures=rows, facts=facts)


def _print(rows: list[dict[str, Any]]) -> None:
    table = Table(
        "size", "M MAC", "flash KiB", "RAM KiB", "stack B", "M instr.", "ms, 1 a cycle", "ms, modelled", "=host"
    )
    for row in rows:
        table.add_row(
            f"{row['dynamics_width']}/{row['decoder_width']} x {row['iterations']} {row['precision']}",
            f"{row['multiply_accumulates'] / 1e6:.1f}",
            f"{row['flash_bytes'] / 1024:.0f}",
            f"{row['ram_bytes'] / 1024:.0f}",
            str(row["stack_bytes"]),
            f"{row['instructions'] / 1e6:.1f}",
            f"{row['one_per_cycle_ms']['480']:.1f}",
            f"{row['modelled_ms']['480']:.1f}",
            str(row["identical"]),
        )
    console.print(table)
