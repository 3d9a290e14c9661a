"""A square cylinder at Re = 100 in the project's own solver, on several grids.

Its wake has been computed by many others, so it shows what the solver gives for a body that it was not written for: a
box with sharp edges, from which the flow separates at the front.

    python -m benchmarks square [--json FILE] [--case 1.0:45 ...]

Each case develops its own wake from rest, then averages over whole cycles of the lift, without control. Finished cases
stay in `runs/square`, so that an interrupted study continues.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer
from rich.progress import Progress
from rich.table import Table

from benchmarks.common.command_line import JsonFile, Parts, console, progress, save
from benchmarks.common.parts import part
from contract.arrays import Array
from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from contract.results import versions
from stillwake.console.terminal import progress_bar
from wake.plant.sample import Sample
from wake.truck.averages import over_cycles
from wake.truck.develop import develop
from wake.truck.truck_wake import TruckWake

CASES: Final = ("0.7:30", "1.0:45")
"""Refinement and time steps a control period. Viscosity bounds the step: it shrinks with the square of the spacing."""

SQUARE: Final = BodyConfig(length=1.0, leading_edge_radius=0.0, sensors_per_side=20)
REYNOLDS: Final = 100.0

LITERATURE: Final = (
    ("Sohankar, Norberg and Davidson 1998, blockage 5 %", "0.146", "1.44 to 1.48", "0.13 to 0.19"),
    ("Sharma and Eswaran 2004, blockage 5 %", "0.149", "1.49", "0.19"),
)
"""Strouhal number, mean drag of all faces and rms lift at Re = 100: Int. J. Numer. Meth. Fluids 26 (1998) 39-56;
Numer. Heat Transfer A 45 (2004) 247-269."""

_COLUMNS: Final = ("St", "Cd_all_faces", "Cd", "Cd_slot", "Cd_momentum_balance", "Cl_std", "base_Cp")
_UPSTREAM, _DOWNSTREAM = -3.0, 12.0


def main(
    json_file: JsonFile = None,
    case: Annotated[list[str], typer.Option(help="refinement:steps a control period")] = list(CASES),  # noqa: B006
    develop_time: Annotated[float, typer.Option(help="From rest until the averages begin, t_c.")] = 200.0,
    average_time: Annotated[float, typer.Option(help="Length of the average, t_c.")] = 80.0,
    parts: Parts = Path("runs/square"),
) -> None:
    """Run each case and print a table."""
    rows: list[dict[str, Any]] = []
    with progress_bar("t_c", console=progress) as bar:
        for name in case:
            refinement, substeps = name.split(":")
            path = parts / f"{refinement}_{substeps}_{develop_time:g}_{average_time:g}.json"
            rows.append(part(path, partial(_study, float(refinement), int(substeps), develop_time, average_time, bar)))
    table = Table("case", *_COLUMNS)
    for row in rows:
        table.add_row(row["case"], *(f"{row[name]:.4f}" for name in _COLUMNS))
    console.print(table)
    facts = {
        "develop_time": develop_time,
        "average_time": average_time,
        "reynolds": REYNOLDS,
        "length": SQUARE.length,
        "leading_edge_radius": SQUARE.leading_edge_radius,
        "versions": versions("stillwake", "numpy", "numba"),
    }
    save(json_file, figures=rows, facts=facts)


def _study(refinement: float, substeps: int, develop_time: float, average_time: float, bar: Progress) -> dict[str, Any]:
    wake = TruckWake(FlowConfig(reynolds=REYNOLDS, substeps=substeps, refinement=refinement), body=SQUARE)
    nx, ny = wake.grid.shape
    task = bar.add_task(f"{nx} x {ny}, {substeps}", total=develop_time + average_time, note="")
    develop(wake, develop_time, lambda t, _: bar.update(task, completed=round(t, 1)))
    free = _cycle_average(wake, average_time, lambda t: bar.update(task, completed=round(develop_time + t, 1)))
    return {
        "case": f"{nx} x {ny}, dt 1/{5 * substeps}",
        "refinement": refinement,
        "steps_per_period": substeps,
        "cells": nx * ny,
        "Cd_all_faces": free["Cd"] + free["Cd_slot"],
        **free,
    }


def _cycle_average(wake: TruckWake, duration: float, progress: Callable[[float], None]) -> dict[str, Any]:
    """Averages over whole cycles of the lift without forcing, in `duration` t_c from the present state on."""
    samples: list[Sample] = []
    balance: list[float] = []
    for _ in range(round(duration / wake.config.control_period)):
        samples.append(wake.advance(0.0))
        balance.append(_momentum_loss(wake))
        progress(samples[-1].t)

    def series(name: str) -> Array:
        return np.array([getattr(s, name) for s in samples])

    average, Cp = over_cycles(series("t"), series("Cl")), series("Cp")
    return {
        **{name: float(average.mean(series(name))) for name in ("Cd", "Cd_slot", "Cd_momentum", "jet_power")},
        "Cd_std": float(average.std(series("Cd"))),
        "Cd_momentum_balance": float(average.mean(balance)),
        "Cl_std": float(average.std(series("Cl"))),
        "Cl_mean": float(average.mean(series("Cl"))),
        "St": average.frequency,
        "base_Cp": float(average.mean(Cp[:, wake.layout.base].mean(axis=1))),
        "Uy": float(average.std(series("Uy_probe"))),
        "Cp_mean": average.mean(Cp).tolist(),
        "Cp_std": average.std(Cp).tolist(),
    }


def _momentum_loss(wake: TruckWake) -> float:
    """Momentum that enters far upstream less what leaves in the wake: its mean is the force on body and slots plus
    the jets' momentum, without looking at the wall."""
    first, last = (int(np.searchsorted(wake.grid.xf, x)) for x in (_UPSTREAM, _DOWNSTREAM))
    return _momentum_flux(wake, first) - _momentum_flux(wake, last)


def _momentum_flux(wake: TruckWake, i: int) -> float:
    grid, flow = wake.grid, wake.flow
    u, p = flow.faces_u[i], 0.5 * (flow.cells_p[i - 1] + flow.cells_p[i])
    stretching = (flow.faces_u[i + 1] - flow.faces_u[i - 1]) / (grid.xf[i + 1] - grid.xf[i - 1])
    stress = 2.0 * wake.solver.viscosity * stretching
    return float(2.0 * np.sum((p + u * u - stress) * grid.dy))
