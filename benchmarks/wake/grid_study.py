"""The wake on several grids and with several time steps, uncontrolled and forced.

The mean drag is measured twice: on the wall, and as the momentum that a far control volume loses.

    python -m benchmarks wake [--json FILE] [--case 1.0:30 ...]

Each case develops its own wake from rest, then averages without control, then under a sine of full amplitude. Finished
cases stay in `runs/grid_study`, so that an interrupted study continues; the finest takes five minutes on one core.
"""

import time
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
from contract.config.plant import FlowConfig
from contract.results import versions
from stillwake.console.terminal import progress_bar
from wake.plant.sample import Sample
from wake.truck.averages import over_cycles
from wake.truck.develop import develop
from wake.truck.truck_wake import TruckWake

CASES: Final = ("0.7:30", "1.0:30", "1.0:60", "1.4:42")
"""Refinement and time steps a control period."""

FORCING_FREQUENCY: Final = 0.1994
"""The shedding frequency of the default grid, 1/t_c."""

_COLUMNS: Final = ("Cd", "Cd_momentum_balance", "Cl_std", "St", "base_Cp", "Uy", "forced_Cd", "forced_Cd_slot")
_UPSTREAM, _DOWNSTREAM = -3.0, 12.0


def main(
    json_file: JsonFile = None,
    case: Annotated[list[str], typer.Option(help="refinement:steps a control period")] = list(CASES),  # noqa: B006
    develop_time: Annotated[float, typer.Option(help="From rest until the averages begin, t_c.")] = 120.0,
    average_time: Annotated[float, typer.Option(help="Length of each average, t_c.")] = 60.0,
    settle_time: Annotated[float, typer.Option(help="From the forcing's start to its average, t_c.")] = 30.0,
    parts: Parts = Path("runs/grid_study"),
) -> None:
    """Run each case and print a table."""
    times = {"develop_time": develop_time, "average_time": average_time, "settle_time": settle_time}
    rows: list[dict[str, Any]] = []
    with progress_bar("t_c", console=progress) as bar:
        for name in case:
            refinement, substeps = name.split(":")
            path = parts / f"{refinement}_{substeps}_{develop_time:g}_{average_time:g}_{settle_time:g}.json"
            rows.append(part(path, partial(_study, float(refinement), int(substeps), **times, bar=bar)))
    table = Table("case", *_COLUMNS)
    for row in rows:
        table.add_row(row["case"], *(f"{row[name]:.4f}" for name in _COLUMNS))
    console.print(table)
    facts = {**times, "forcing_frequency": FORCING_FREQUENCY, "versions": versions("stillwake", "numpy", "numba")}
    save(json_file, figures=rows, facts=facts)


def _study(
    refinement: float, substeps: int, develop_time: float, average_time: float, settle_time: float, bar: Progress
) -> dict[str, Any]:
    wake = TruckWake(FlowConfig(substeps=substeps, refinement=refinement))
    nx, ny = wake.grid.shape
    task = bar.add_task(f"{nx} x {ny}, {substeps}", total=develop_time + 2 * average_time + settle_time, note="")
    began = time.process_time()
    develop(wake, develop_time, lambda t, _: bar.update(task, completed=round(t, 1)))
    cpu = {"cpu_s_per_t_c": (time.process_time() - began) / develop_time}
    free = cycle_average(
        wake, average_time, lambda t: 0.0, lambda t: bar.update(task, completed=round(develop_time + t, 1))
    )
    limit, settled = wake.config.action_limit, average_time

    def sine(t: float) -> float:
        return limit * float(np.sin(2.0 * np.pi * FORCING_FREQUENCY * t))

    while wake.t < settled + settle_time:
        wake.advance(sine(wake.t))
        bar.update(task, completed=round(develop_time + wake.t, 1))
    forced = cycle_average(wake, average_time, sine, lambda t: bar.update(task, completed=round(develop_time + t, 1)))
    return {
        "case": f"{nx} x {ny}, dt 1/{5 * substeps}",
        "refinement": refinement,
        "steps_per_period": substeps,
        "cells": nx * ny,
        **free,
        **{f"forced_{name}": value for name, value in forced.items()},
        **cpu,
    }


def cycle_average(
    wake: TruckWake, duration: float, signal: Callable[[float], float], progress: Callable[[float], None]
) -> dict[str, Any]:
    """Averages over whole cycles of the lift.

    Args:
        wake: the plant, run on from its present state.
        duration: in t_c.
        signal: action to command at a time.
        progress: called with the time.
    """
    samples: list[Sample] = []
    balance: list[float] = []
    for _ in range(round(duration / wake.config.control_period)):
        samples.append(wake.advance(signal(wake.t)))
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
