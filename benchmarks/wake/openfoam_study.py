"""The truck's wake by OpenFOAM's icoFoam next to the own solver: uncontrolled, forced, and in the closed loop.

    python -m benchmarks openfoam [--json FILE] [--only PART]

Takes hours. Every part is kept in `runs/openfoam` when it is done, and the uncontrolled runs continue from their last
checkpoint, so that the study can be interrupted. `--json` writes the parts that are there.
"""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import Annotated, Any, Final

import numpy as np
import typer
from rich.progress import Progress, TaskID

from benchmarks.common.command_line import JsonFile, console, progress, save
from benchmarks.common.commands import ROOT
from contract import sensors
from contract.arrays import Array
from contract.atomic import replacing
from contract.config.loading import load_config
from contract.config.plant import FlowConfig
from contract.release.bundle import load
from contract.results import versions
from contract.shipped import BUNDLE
from firmware_sim.bench.closed_loop import run_closed_loop
from firmware_sim.runs.summary import summary
from stillwake.console.terminal import progress_bar
from wake.openfoam import start, state
from wake.openfoam.develop import settle
from wake.openfoam.interpolation import CellInterpolation
from wake.openfoam.measurements import Instruments, read_all
from wake.openfoam.mesh import truck_mesh
from wake.openfoam.plant import OpenFoamWake
from wake.openfoam.process import LOG
from wake.plant.sample import Sample
from wake.truck.averages import over_cycles
from wake.truck.state import developed_state
from wake.truck.truck_wake import TruckWake

FOLDER: Final = ROOT / "runs" / "openfoam"

# Refinement, time steps a control period, time left out and time averaged, t_c. The first starts from the own solver's
# developed wake, each other one from the end of the one before.
UNCONTROLLED: Final = ((1.0, 20, 45.0, 40.0), (1.5, 30, 20.0, 20.0))
FREQUENCY: Final = 0.198
FORCED_TIME: Final = 40.0
FORCED_SETTLE: Final = 10.0
LEAD_IN: Final = 10.0
CONTROLLED: Final = 50.0
SETTLE: Final = 20.0

Bar = Callable[[float, float], None]


def main(
    json_file: JsonFile = None,
    only: Annotated[str, typer.Option(help="uncontrolled-1, uncontrolled-1.5, forced or loop; default: all.")] = "",
) -> None:
    """Run what is missing and print all figures."""
    parts: dict[str, Callable[[Bar], list[dict[str, Any]]]] = {
        **{f"uncontrolled-{row[0]:g}": partial(_uncontrolled, k) for k, row in enumerate(UNCONTROLLED)},
        "forced": _forced,
        "loop": _loop,
    }
    figures: dict[str, list[dict[str, Any]]] = {}
    with progress_bar("t_c", console=progress) as bar:
        for name, part in parts.items():
            kept = FOLDER / f"{name}.json"
            if only in ("", name) and not kept.is_file():
                found = part(partial(_show, bar, bar.add_task(name, total=None, note="")))
                with replacing(kept) as temporary:
                    temporary.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
            if kept.is_file():
                figures.setdefault(name.split("-")[0], []).extend(json.loads(kept.read_text(encoding="utf-8")))
    console.print_json(json.dumps(figures))
    facts = {
        "uncontrolled": [
            dict(zip(("refinement", "substeps", "settle", "average"), row, strict=True)) for row in UNCONTROLLED
        ],
        "forced": {"frequency": FREQUENCY, "amplitude": FlowConfig().action_limit, "settle": FORCED_SETTLE},
        "forced_time": FORCED_TIME,
        "loop": {"lead_in": LEAD_IN, "controlled": CONTROLLED, "settle": SETTLE},
        "versions": versions("stillwake", "numpy", "scipy", "numba"),
    }
    save(json_file, figures=figures, facts=facts)


def _case(refinement: float) -> Path:
    return FOLDER / f"uncontrolled-{refinement:g}"


def _show(bar: Progress, task: TaskID, done: float, total: float) -> None:
    bar.update(task, completed=round(done, 1), total=total)


def _uncontrolled(index: int, show: Bar) -> list[dict[str, Any]]:
    refinement, substeps, left_out, average = UNCONTROLLED[index]
    config, mesh, folder = FlowConfig(), truck_mesh(refinement), _case(refinement)

    def begin() -> tuple[Array, Array]:
        if index == 0:
            return start.from_own_solver(developed_state(), mesh)
        coarser = UNCONTROLLED[index - 1]
        source, last = truck_mesh(coarser[0]), state.written(_case(coarser[0]), dt=config.control_period / coarser[1])
        between = CellInterpolation(source, mesh.centres)
        return between(last.velocity), between(last.pressure)

    settle(folder, mesh, begin, config, substeps=substeps, until=left_out + average, progress=show)
    times, readings = read_all(folder)
    instruments = Instruments(mesh)
    samples = [
        instruments.sample(item, t=float(t), action=0.0)
        for t, item in zip(times, readings, strict=True)
        if left_out < t <= left_out + average + 1e-6
    ]
    return [
        {
            "case": f"OpenFOAM, {len(mesh.cells):,} cells, dt 1/{substeps / config.control_period:g}",
            **_figures(samples),
            "cpu_s_per_t_c": _cpu_per_time(folder),
        }
    ]


def _forced(show: Bar) -> list[dict[str, Any]]:
    """The same sine on both plants, each from its own developed wake.

    Which state the wake locks onto depends on where in its cycle the sine begins, so the own plant begins twice.
    """
    own = TruckWake()
    rows = []
    for case, lead in (("stillwake", 0), ("stillwake, begun half a cycle later", 12)):
        own.reset(developed_state())
        for _ in range(lead):
            own.advance(0.0)
        own.reset(replace(own.state(), substep=0))
        began = process_time()
        row = _sine(case, own, show)
        rows.append({**row, "cpu_s_per_t_c": (process_time() - began) / FORCED_TIME})
    begin = state.written(_case(1.0), dt=FlowConfig().control_period / UNCONTROLLED[0][1])
    with OpenFoamWake(FOLDER / "forced", begin, duration=FORCED_TIME) as foam:
        rows.append({**_sine("OpenFOAM", foam, show), "cpu_s_per_t_c": _cpu_per_time(FOLDER / "forced")})
    return rows


def _sine(case: str, plant: TruckWake | OpenFoamWake, show: Bar) -> dict[str, Any]:
    limit, period = plant.config.action_limit, plant.config.control_period
    samples = []
    for k in range(1, round(FORCED_TIME / period) + 1):
        samples.append(plant.advance(limit * float(np.sin(2.0 * np.pi * FREQUENCY * k * period))))
        show(samples[-1].t, FORCED_TIME)
    return {"case": case, **_figures([item for item in samples if item.t > FORCED_SETTLE])}


def _loop(show: Bar) -> list[dict[str, Any]]:
    """The shipped bundle on both plants, from the same release settings."""
    config, bundle = load_config(None, []), load(BUNDLE)
    begin = state.written(_case(1.0), dt=config.flow.control_period / UNCONTROLLED[0][1])
    rows = []
    for case in ("stillwake", "OpenFOAM"):
        plant = None
        if case == "OpenFOAM":
            plant = OpenFoamWake(FOLDER / "loop-case", begin, config.flow, duration=LEAD_IN + CONTROLLED)
        log = run_closed_loop(
            FOLDER / f"loop-{case}", bundle, config, lead_in=LEAD_IN, controlled=CONTROLLED, settle=SETTLE, plant=plant,
            progress=lambda _, done, total: show(done, total),
        )  # fmt: skip
        rows.append({"case": case, **summary(log)})
    return rows


def _figures(samples: list[Sample]) -> dict[str, Any]:
    """Averages over whole cycles of the lift."""

    def series(name: str) -> Array:
        return np.array([getattr(s, name) for s in samples])

    average = over_cycles(series("t"), series("Cl"))
    means = ("Cd", "Cd_slot_pressure", "Cd_slot_viscous", "Cd_momentum", "Cd_net", "jet_power")
    return {
        **{name: float(average.mean(series(name))) for name in means},
        "Cd_std": float(average.std(series("Cd"))),
        "Cl_std": float(average.std(series("Cl"))),
        "mean_Cl": float(average.mean(series("Cl"))),
        "base_Cp": float(average.mean(series("Cp")[:, sensors.BASE].mean(axis=1))),
        "Uy": float(average.std(series("Uy_probe"))),
        "St": average.frequency,
        "cycles": average.cycles,
    }


def _cpu_per_time(folder: Path) -> float:
    """CPU seconds a t_c of the case's last run, from its log: one core, shared with whatever else ran."""
    log = (folder / LOG).read_text(encoding="utf-8")
    times = [float(value) for value in re.findall(r"^Time = (\S+)", log, re.MULTILINE)]
    spent = [float(value) for value in re.findall(r"^ExecutionTime = (\S+)", log, re.MULTILINE)]
    return (spent[-1] - spent[0]) / (times[len(spent) - 1] - times[0])
