"""On which grids the wake keeps up with a control period of 20 ms, and what the shipped controller does on them.

    python -m benchmarks live-speed [--json FILE] [--case 0.75:15 ...]

Each case moves the shipped wake to its grid, averages it without control, and closes the loop in virtual time. Then all
cases are timed in turn, a control period of each at a time, because machines are noisy. Finished cases stay in
`runs/live_speed`, so that an interrupted study continues; times are measured again.
"""

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer
from rich.progress import Progress
from rich.table import Table

from benchmarks.common.command_line import JsonFile, Parts, console, progress, save, track
from benchmarks.common.parts import part
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.release import bundle as bundles
from contract.results import versions
from contract.shipped import BUNDLE
from firmware_sim.bench.closed_loop import run_closed_loop
from firmware_sim.runs.run_log import Row
from firmware_sim.runs.summary import summary
from stillwake.console.terminal import progress_bar
from wake.plant.protocol import LivePlant
from wake.plants import open_plant
from wake.truck.averages import over_cycles
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake

CASES: Final = ("1.0:30", "0.75:23", "0.75:15", "0.7:14", "0.65:20", "0.65:14", "0.5:15", "0.4:12")
"""Refinement and time steps a control period."""
LEAD_IN, CONTROLLED, SETTLE = 25.0, 100.0, 40.0
"""Spans of the closed loop, t_c; as `stillwake run` has them."""
_COLUMNS: Final = (
    "cells",
    "period_ms",
    "period_ms_p90",
    "cpu_ms",
    "Cd",
    "Cl_std",
    "St",
    "reduction_percent",
    "abs_Cl_controlled",
)


def main(
    json_file: JsonFile = None,
    case: Annotated[list[str], typer.Option(help="refinement:steps a control period")] = list(CASES),  # noqa: B006
    average_time: Annotated[float, typer.Option(help="Without control, t_c.")] = 60.0,
    rounds: Annotated[int, typer.Option(help="Timed control periods of every case.")] = 60,
    parts: Parts = Path("runs/live_speed"),
) -> None:
    """Run each case and print a table."""
    digest = bundles.load(BUNDLE).digest
    rows: list[dict[str, Any]] = []
    with progress_bar("t_c", console=progress) as bar:
        for name in case:
            flow = _flow(name)
            path = parts / f"{flow.refinement:g}_{flow.substeps}_{average_time:g}_{digest[:12]}.json"
            rows.append(part(path, partial(_study, flow, average_time, bar=bar)))
    for row, times in zip(rows, _timed([_flow(name) for name in case], rounds), strict=True):
        row.update(times)
    table = Table("case", *_COLUMNS)
    for row in rows:
        table.add_row(row["case"], *(f"{row[name]:.4g}" for name in _COLUMNS))
    console.print(table)
    facts = {
        "bundle": digest,
        "average_time": average_time,
        "lead_in": LEAD_IN,
        "controlled": CONTROLLED,
        "settle": SETTLE,
        "rounds": rounds,
        "versions": versions("stillwake", "numpy", "numba", "onnxruntime"),
    }
    save(json_file, figures=rows, facts=facts)


def _flow(case: str) -> FlowConfig:
    refinement, _, substeps = case.partition(":")
    return FlowConfig(refinement=float(refinement), substeps=int(substeps))


def _study(flow: FlowConfig, average_time: float, *, bar: Progress) -> dict[str, Any]:
    config = Config(flow=flow)
    total = average_time + LEAD_IN + CONTROLLED
    task = bar.add_task(f"refinement {flow.refinement:g}, {flow.substeps} steps", total=total, note="")

    def settling(t: float, of: float) -> None:
        bar.update(task, completed=0.0, note=f"settling {t:.0f} of {of:.0f} t_c")

    with open_plant("stillwake", Path(), config, progress=settling) as wake:
        assert isinstance(wake, TruckWake)
        begin = wake.state()
        samples = []
        for _ in range(round(average_time / flow.control_period)):
            samples.append(wake.advance(0.0))
            bar.update(task, completed=round(wake.t, 1), note="without control")
        lift, drag = np.array([s.Cl for s in samples]), np.array([s.Cd for s in samples])
        average = over_cycles(np.array([s.t for s in samples]), lift)
        controlled = _controlled(wake, begin, config, average_time, partial(bar.update, task))
        nx, ny = wake.grid.shape
        return {
            "case": f"{nx} x {ny}, dt 1/{5 * flow.substeps}",
            "refinement": flow.refinement,
            "steps_per_period": flow.substeps,
            "cells": nx * ny,
            "slot_cells": wake.grid.slot_cells,
            "Cd": float(average.mean(drag)),
            "Cl_std": float(average.std(lift)),
            "St": average.frequency,
            **controlled,
        }


def _controlled(wake: TruckWake, begin: State, config: Config, done: float, show: Any) -> dict[str, Any]:
    """What the shipped controller makes of the wake, in virtual time."""

    def progressed(row: Row, periods: int, total: int) -> None:
        show(completed=round(done + periods * config.flow.control_period, 1), note="under control")

    with tempfile.TemporaryDirectory() as folder:
        log = run_closed_loop(
            Path(folder) / "run",
            bundles.load(BUNDLE),
            config,
            lead_in=LEAD_IN,
            controlled=CONTROLLED,
            settle=SETTLE,
            plant=_from(wake, begin),
            progress=progressed,
        )
    figures = summary(log)
    kept = ("reduction_percent", "Cd_controlled", "abs_Cl_uncontrolled", "abs_Cl_controlled", "rms_action", "modes")
    return {name: figures[name] for name in kept}


@contextmanager
def _from(wake: TruckWake, begin: State) -> Iterator[LivePlant]:
    wake.reset(begin)
    yield wake


def _timed(flows: list[FlowConfig], rounds: int) -> list[dict[str, float]]:
    """Wall and processor time of a control period of each, sampling included."""
    plants = [TruckWake(flow) for flow in flows]
    for wake in plants:
        wake.reset(State(flat=wake.solver.start().flat, substep=0, action=0.0))
        # The time of a step does not depend on the flow, but for a start from rest a step has to be short.
        wake.solver.run(wake.flow, dt=1e-4, steps=20, action_from=0.0, action_to=0.0)
    wall: list[list[float]] = [[] for _ in plants]
    cpu: list[list[float]] = [[] for _ in plants]
    for _ in track(range(rounds), "timing", "rounds"):
        for wake, of_wall, of_cpu in zip(plants, wall, cpu, strict=True):
            began, spent = time.perf_counter(), time.process_time()
            wake.solver.run(wake.flow, dt=1e-4, steps=wake.config.substeps, action_from=0.0, action_to=0.0)
            wake.sample()
            of_wall.append((time.perf_counter() - began) * 1e3)
            of_cpu.append((time.process_time() - spent) * 1e3)
    return [
        {
            "period_ms": float(np.median(of_wall)),
            "period_ms_p90": float(np.quantile(of_wall, 0.9)),
            "cpu_ms": float(np.median(of_cpu)),
        }
        for of_wall, of_cpu in zip(wall, cpu, strict=True)
    ]
