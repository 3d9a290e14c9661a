"""The release at other speeds: steady speeds, drives, a wrong speed signal, another air density and another viscosity.

    python -m benchmarks drive [--quick] [--only steady-120] [--json FILE]

Each row is a run of `stillwake run --drive`: 25 t_c at the design speed without control, then the drive. The first 40
t_c of the drive are not evaluated. For comparison, the same drive is run with the jets shut.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from statistics import median
from typing import Annotated, Any, Final, NamedTuple

import typer

from benchmarks.common.command_line import JsonFile, Parts, Phases, Workers, kept_runs, made_from, report
from benchmarks.release.release_loop import facts_of
from benchmarks.release.tables import drive as drive_table
from contract.config.loading import load_config
from contract.config.tree import Config
from contract.errors import StillwakeError
from contract.release import bundle as bundles
from contract.shipped import BUNDLE
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.simulation import Simulation, Spans
from firmware_sim.campaign.folder import phases_apart
from firmware_sim.runs.control import trouble
from firmware_sim.runs.statistics import drive_totals
from stillwake.parts.differentiable_wake import mesh_of
from wake.plant.drive import PROFILES, find_drive
from wake.plants import own_wake
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake

LEAD_IN, SETTLE = 25.0, 40.0
"""Time without control, and settling time that is not evaluated, in convective times at the design speed."""


class Case(NamedTuple):
    """A row of the table: a drive and its disturbances."""

    drive: str
    disturbed: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name that selects the row; the row's runs are stored under this name."""
        return ", ".join((self.drive, *self.disturbed))


CASES: Final = (
    *map(Case, PROFILES),
    *(Case("ramps", (f"speed_scale={scale}",)) for scale in ("0.9", "0.95", "1.05", "1.1")),
    # The speed freezes in the middle of the first ramp.
    *(Case("ramps", (text,)) for text in ("speed_late=0.5", "no_speed", "speed_frozen@10..")),
    *(Case("steady-120", (text,)) for text in ("density=1.05", "density:density=1.05,stated=true")),
    Case("steady-100", ("reynolds=1000",)),
)


def main(
    json_file: JsonFile = None,
    parts: Parts = Path("runs/drive"),
    quick: Annotated[bool, typer.Option("--quick", help="Use the mesh of refine.*, in a quarter of the time.")] = False,
    only: Annotated[list[str], typer.Option(help="Name of a row (repeatable); default: all.")] = [],  # noqa: B006
    phases: Phases = 1,
    workers: Workers = 1,
) -> None:
    """Run every row from every start and print a table."""
    if unknown := set(only) - {case.name for case in CASES}:
        raise StillwakeError(f"--only {min(unknown)}: must be one of {'; '.join(case.name for case in CASES)}")
    release = bundles.load(BUNDLE)
    config = mesh_of(load_config()) if quick else load_config()
    cases = [case for case in CASES if not only or case.name in only]
    folder = parts / f"{made_from(release.digest)}_{config.flow.refinement:g}_{phases}"
    runs = {folder / f"{case.name}_{phase}.json": (case, phase, phases) for case in cases for phase in range(phases)}
    outcomes = kept_runs(partial(outcome, config), runs, workers=workers, label="drive")
    rows = [_row(case, outcomes[k * phases : (k + 1) * phases]) for k, case in enumerate(cases)]
    facts = facts_of(release, mesh=config.flow.refinement, lead_in=LEAD_IN, settle=SETTLE, phases=phases)
    report(json_file, rows, facts, drive_table)


def _row(case: Case, runs: list[dict[str, Any]]) -> dict[str, Any]:
    medians = {name: median(run[name] for run in runs) for name in runs[0] if name not in ("name", "trouble")}
    percent = int(case.drive.removeprefix("steady-")) if case.drive.startswith("steady-") else None
    reductions = [run["reduction_percent"] for run in runs]
    return {
        "name": case.name,
        "speed_percent": percent,
        "disturbed": list(case.disturbed),
        **medians,
        "reduction_least": min(reductions),
        "reduction_most": max(reductions),
        "trouble": [run["trouble"] for run in runs if run["trouble"] is not None],
    }


def outcome(config: Config, case: Case, phase: int, phases: int) -> Mapping[str, Any]:
    """Return the totals of the drive in one run."""
    release, point = bundles.load(BUNDLE), config.operating_point
    drive = find_drive(case.drive, point)
    flow = drive.substeps(config.flow, point)
    if any(text.startswith("reynolds") for text in case.disturbed):
        # At a higher Reynolds number the solver diverged with the usual time steps.
        flow = replace(flow, substeps=2 * flow.substeps)
    wake = TruckWake(flow, body=config.body)
    wake.reset(replace(_start(config), substep=0))
    for _ in range(phases_apart(phases, config)[phase]):
        wake.advance(0.0)
    spans = Spans(lead_in=LEAD_IN, controlled=drive.duration_s / point.convective_time, settle=SETTLE)
    driven = replace(config, flow=flow, mpc=release.manifest.mpc)
    disturbed = Disturbances.parse(case.disturbed)
    log = Simulation(release, driven, spans=spans, disturbances=disturbed, drive=drive).run(wake)
    totals = drive_totals(log)
    assert totals is not None
    return {**totals.rounded(), "trouble": trouble(log)}


@cache
def _start(config: Config) -> State:
    return own_wake(config).state()
