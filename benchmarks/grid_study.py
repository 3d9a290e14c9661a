"""The uncontrolled wake on several grids, beside an OpenFOAM reference.

    python benchmarks/grid_study.py [--json FILE] [--refinement 0.7 ...]

Each grid develops its own wake from rest. The finest takes about ten minutes on one core.
"""

import time
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from contract import sensors
from contract.config import FlowConfig
from contract.results import versions, write_result
from wake.develop import develop
from wake.truck_wake import TruckWake

# OpenFOAM 1912, icoFoam, second order, body-fitted mesh; Cp relative to the outlet, Cd without the slot faces.
REFERENCE: Final = (
    ("OpenFOAM, 10,288 cells, dt 0.02", 1.067, 0.966, 0.193, -0.445, 0.509),
    ("OpenFOAM, 32,728 cells, dt 0.01", 1.079, 1.101, 0.1984, -0.491, 0.541),
)
_COLUMNS: Final = ("case", "Cd", "Cl_std", "St", "base_Cp", "Uy")


def main(
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures here.")] = None,
    refinement: Annotated[list[float], typer.Option(help="Divides every spacing.")] = [0.7, 1.0, 1.4],  # noqa: B006
    develop_time: Annotated[float, typer.Option(help="From rest until the averages begin, t_c.")] = 140.0,
    average_time: Annotated[float, typer.Option(help="Length of the averages, t_c.")] = 60.0,
) -> None:
    """Run each grid and print a table."""
    rows: list[dict[str, Any]] = [dict(zip(_COLUMNS, row, strict=True)) for row in REFERENCE]
    with Progress(console=Console(stderr=True)) as bar:
        for value in refinement:
            rows.append(_uncontrolled(value, develop_time, average_time, bar))
    table = Table(*_COLUMNS)
    for row in rows:
        table.add_row(str(row["case"]), *(f"{row[name]:.4f}" for name in _COLUMNS[1:]))
    Console().print(table)
    if json_file is not None:
        facts = {
            "develop_time": develop_time,
            "average_time": average_time,
            "versions": versions("stillwake", "numpy", "numba"),
        }
        write_result(json_file, figures=rows, facts=facts, on=date.today())


def _uncontrolled(refinement: float, develop_time: float, average_time: float, bar: Progress) -> dict[str, Any]:
    # The convective limit shrinks with the cells.
    substeps = round(FlowConfig().substeps * max(1.0, refinement))
    wake = TruckWake(FlowConfig(substeps=substeps), refinement)
    nx, ny = wake.grid.shape
    task = bar.add_task(f"{nx} x {ny}", total=develop_time + average_time)
    began = time.process_time()
    develop(wake, develop_time, lambda t, _: bar.update(task, completed=t))
    samples = []
    for _ in range(round(average_time / wake.config.control_period)):
        samples.append(wake.advance(0.0))
        bar.update(task, completed=develop_time + samples[-1].t)
    cl = np.array([s.Cl for s in samples])
    up = np.flatnonzero((cl[:-1] < 0) & (cl[1:] >= 0))
    crossings = up - cl[up] / (cl[up + 1] - cl[up])
    return {
        "case": f"stillwake, {nx} x {ny} cells, dt 1/{5 * substeps}",
        "refinement": refinement,
        "Cd": float(np.mean([s.Cd for s in samples])),
        "Cl_std": float(cl.std()),
        "St": float(1.0 / (np.diff(crossings).mean() * wake.config.control_period)),
        "base_Cp": float(np.mean([s.Cp[sensors.BASE].mean() for s in samples])),
        "Uy": float(np.std([s.Uy_probe for s in samples])),
        "cpu_s_per_t_c": (time.process_time() - began) / (develop_time + average_time),
    }


if __name__ == "__main__":
    typer.run(main)
