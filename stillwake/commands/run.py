"""The commands that close the loop and show what came of it."""

from datetime import date
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from contract.config.loading import load_config
from contract.errors import StillwakeError
from contract.results import write_result
from stillwake.releases import Trust, describe, open_release
from stillwake.terminal import ConfigFile, JsonFile, Overrides, console, progress_bar


def run(
    output: Annotated[Path, typer.Argument(help="Run folder to write.")],
    bundle: Annotated[Path | None, typer.Option(help="Release bundle; default: the shipped one.")] = None,
    trust: Trust = None,
    library: Annotated[
        Path | None, typer.Option(help="Run this C library of the bundle's (`export --c`) in place of ONNX Runtime.")
    ] = None,
    lead_in: Annotated[float, typer.Option(help="Time without control, t_c.", min=0.2)] = 25.0,
    controlled: Annotated[float, typer.Option(help="Time with control, t_c.", min=0.2)] = 100.0,
    settle: Annotated[float, typer.Option(help="Left out of the controlled averages, t_c.", min=0.0)] = 40.0,
    plant: Annotated[str, typer.Option(help="stillwake (own solver) or openfoam (icoFoam; far slower).")] = "stillwake",
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Close the loop: live wake, pressures on CAN, the bundle's controller on the ECU, jets; in virtual time."""
    from can_bridge.wire.messages import Mode
    from firmware_sim.bench.closed_loop import run_closed_loop
    from firmware_sim.ecu.library_controller import open_library
    from firmware_sim.runs.report import write_report
    from firmware_sim.runs.run_folder import RunFolder
    from firmware_sim.runs.run_log import Row
    from firmware_sim.runs.summary import summary
    from firmware_sim.runs.tables import drag_rows, headline, service_rows
    from wake.plants import open_plant

    config = load_config(config_file, overrides)
    release = open_release(bundle, trust)
    if plant not in ("stillwake", "openfoam"):
        raise StillwakeError(f"--plant {plant}: must be stillwake or openfoam")
    console.print(*describe(release), sep="\n", soft_wrap=True)
    controller = None
    if library is not None:
        controller = open_library(library, release)
        console.print(f"library {library}: {controller.description}", soft_wrap=True, markup=False)
    with progress_bar("periods") as bar:
        task = bar.add_task("closed loop", total=None, note="")

        def show(row: Row, done: int, total: int) -> None:
            note = (
                f"{Mode(row.mode).name:7s} Cd {row.sample.Cd:.3f}  base Cp {row.base_Cp:+.3f}  "
                f"action {row.sample.action:+.3f}  step {row.step_ms:.1f} ms"
            )
            bar.update(task, completed=done, total=total, note=note)

        def show_start(t: float, total: float) -> None:
            bar.update(task, completed=round(t, 1), total=total, note="t_c of the wake's development", refresh=True)

        flow = open_plant(
            "openfoam" if plant == "openfoam" else "stillwake", output, config, lead_in + controlled, show_start
        )
        log = run_closed_loop(
            output,
            release,
            config,
            lead_in=lead_in,
            controlled=controlled,
            settle=settle,
            progress=show,
            plant=flow,
            controller=controller,
        )
    folder = RunFolder(output)
    page = write_report(folder)
    if json_file is not None:
        write_result(json_file, figures=summary(log), facts=log.metadata.to_tree(), on=date.today())
    table = Table("", "uncontrolled", "controlled")
    for label, before, under in drag_rows(log):
        table.add_row(label, before, under)
    service = Table("bus and ECU", "")
    for label, value in service_rows(log):
        service.add_row(label, value)
    for item in (table, service, headline(log), f"wrote {page} and {folder.summary}"):
        console.print(item)


def report(
    run_folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder written by `run`.")],
    picture: Annotated[Path | None, typer.Option(help="Also write the run as one PNG here.")] = None,
) -> None:
    """Write a run's HTML page anew from its series."""
    from firmware_sim.runs.report import write_picture, write_report
    from firmware_sim.runs.run_folder import RunFolder

    folder = RunFolder(run_folder)
    console.print(f"wrote {write_report(folder)}")
    if picture is not None:
        write_picture(folder, picture)
        console.print(f"wrote {picture}")
