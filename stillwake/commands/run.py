"""The command that runs the closed loop."""

import shlex
import sys
from collections.abc import Mapping
from datetime import date
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from contract.config.tree import Config
from contract.errors import ConfigError, LibraryError
from contract.release.checks import Bundle
from stillwake.console import options as shared
from stillwake.console.outputs import check_apart, check_frames, check_json, claim, print_written, save_json
from stillwake.console.progress import progress
from stillwake.console.settings import VIRTUAL_BUS, settings
from stillwake.console.terminal import console, print_table, visible
from stillwake.parts.c_release import library_folder
from stillwake.parts.releases import asked_calibration, describe, open_release
from stillwake.parts.wakes import driven_at

if TYPE_CHECKING:
    from ecu.stepped import LoopEcu
    from firmware_sim.bench.simulation import Spans
    from firmware_sim.runs.run_log import Row, RunLog
    from wake.plant.drive import Drive

_USES: Final = ("body", "operating_point", "flow", "bus.interface", *VIRTUAL_BUS, "ecu", "vehicle", "mpc")
PYTHON: Final = "python"
ECUS: Final = (PYTHON, "c", "mcu")

EcuName = Annotated[
    str, typer.Option("--ecu", help="python, c (on this machine), mcu (emulated), or mcu@MHZ.", metavar="ECU")
]
Controlled = Annotated[float | None, typer.Option(help="Time with control, t_c (100, or the drive's time).", min=0.2)]
NoAverages = Annotated[bool, typer.Option("--no-averages", help="Compute no averages; the run may be short.")]
LeastReduction = Annotated[float | None, typer.Option(help="Exit with status 4 unless drag falls by this percentage.")]
PlantName = Annotated[Literal["wake", "openfoam"], typer.Option("--plant", help="Solver; openfoam is far slower.")]
Disturb = Annotated[list[str], typer.Option(metavar="TEXT", help="KIND:PARAMETER=VALUE@START..END (repeatable).")]


def run(
    output: Annotated[Path, typer.Argument(help="Run folder to write.")],
    bundle: shared.Bundle = None,
    library: shared.Library = None,
    ecu: EcuName = PYTHON,
    lead_in: shared.LeadIn = 25.0,
    controlled: Controlled = None,
    settle: Annotated[float, typer.Option(help="Time with control before the averages begin, t_c.", min=0.0)] = 40.0,
    no_averages: NoAverages = False,
    require_reduction: LeastReduction = None,
    plant: PlantName = shared.WAKE,
    state: shared.State = None,
    drive: shared.Drive = None,
    disturb: Disturb = [],  # noqa: B006
    seed: shared.Seed = 0,
    overwrite: shared.Overwrite = False,
    frames: shared.Frames = None,
    json_file: shared.JsonFile = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Run the closed loop in virtual time: wake, pressures on CAN, the controller on the ECU, and jets.

    Exit status 3: the ECU latched a fault, or was not in control while control was requested. Status 4: the reduction
    of --require-reduction was not reached. The run folder is complete in both cases.

    --ecu c runs the whole ECU from its C sources. With --ecu mcu the sources run as the firmware of an emulated
    microcontroller, from its reset vector. Frames pass through the registers of its CAN controller, and modelled cycles
    give the compute time, at 480 MHz, or at 300 MHz with mcu@300 (docs/how-to/board-and-rtos.md). The sources are in
    the folder of --library, or are made from the shipped model.

    --disturb may be given several times, for example noise:level=0.5 at the transducers, ecu:drop:probability=0.1@5..10
    for frames that the ECU sends, reset@5 for the ECU, reynolds=700 for the flow; times are in s from the start of the
    run. The kinds are noise, bias, drift, stuck, dead, swap, quantise, wire_errors, reset, clock, no_request, reynolds,
    body, gust, operating_point, action_limit, stuck_jets, speed_scale, speed_late, speed_frozen, no_speed and density
    (docs/reference/disturbances.md). Faults of one node are written with vehicle: or ecu: before their kind: drop,
    burst_loss, duplicate, delay, reorder, flip_bits, stuck_at, babble, disconnect, slow_consumer or clock_drift.

    --drive gives the vehicle a varying speed. The drive is first run without control, to compare the energy. Drives are
    steady-60 to steady-140 (percent of operating_point.speed, in tens), steps, ramps, wltc-high, gusty-ramp, or a CSV
    file with the columns t_s and speed_m_per_s. docs/how-to/drive-at-other-speeds.md has more.
    """
    from firmware_sim.bench.disturbances import Disturbances
    from firmware_sim.runs.run_log import RunFolder
    from firmware_sim.runs.run_page.measurement import write_run
    from firmware_sim.runs.summary import summary

    _check_reduction(require_reduction, averages=not no_averages)
    kind, clock_mhz = ecu_of(ecu)
    disturbances = Disturbances.parse(disturb)
    folder = RunFolder(output)
    claim(output, folder=True)
    folder.check_free(overwrite=overwrite)
    check_json(json_file, frames, state, *vars(folder).values())
    check_frames(frames)
    loaded = settings("run", given, uses=(*_USES, *(["openfoam"] if plant == "openfoam" else [])))
    key = loaded.config.bus.key
    check_apart(json_file, frames, state, Path(key) if key else None)
    release = open_release(bundle)
    driven, config = driven_at(drive, loaded.config)
    chosen = {
        "calibration": asked_calibration(loaded, release),
        "spans": _spans(config, driven, lead_in, controlled, settle, averages=not no_averages),
        "drive": driven,
        "disturbances": disturbances,
        "seed": seed,
    }
    console.print(*describe(release), sep="\n")
    if config.ecu.sensor_check.enabled and release.manifest.sensor_estimator is None:
        console.print("sensor check: off, this bundle has no sensor estimator")
    in_c = None if kind == PYTHON else _ecu_in_c(kind, clock_mhz, library, release, config)
    log = _closed(output, release, config, plant, state, in_c, library, chosen)
    save_json(json_file, figures=summary(log), facts=log.metadata.to_tree())
    _print(log)
    if frames is not None:
        print_written(frames, write_run(frames, folder))
    console.print(f"wrote {folder.report} and {folder.summary}")
    exit_with(log, require_reduction)


def ecu_of(text: str) -> tuple[str, float]:
    """Return kind and clock frequency in MHz from a text such as mcu@300. Raises ConfigError for another text."""
    kind, at, clock = text.partition("@")
    if kind not in ECUS or (at and kind != "mcu"):
        raise ConfigError(f"--ecu {text}: must be one of {', '.join(ECUS)}, or a clock in MHz as in mcu@300")
    try:
        return kind, float(clock) if at else 480.0
    except ValueError:
        raise ConfigError(f"--ecu {text}: {clock!r} must be a clock in MHz, as in mcu@300") from None


def _check_reduction(percent: float | None, *, averages: bool) -> None:
    if percent is None:
        return
    if not averages:
        raise ConfigError("--require-reduction needs averages: leave out --no-averages")
    if not isfinite(percent):
        raise ConfigError(f"--require-reduction {percent}: must be a number of percent")
    if 0.0 < abs(percent) < 1.0:
        remedy = f"for {100 * percent:g} % write {100 * percent:g}"
        raise ConfigError(f"--require-reduction {percent:g}: must be in percent; {remedy}")


def _spans(
    config: Config, drive: "Drive | None", lead_in: float, controlled: float | None, settle: float, *, averages: bool
) -> "Spans":
    """Return the run's spans. Invalid times raise an error here, before a C library is made."""
    from firmware_sim.bench.simulation import Spans

    if controlled is None:
        controlled = 100.0 if drive is None else drive.duration_s / config.operating_point.convective_time
    spans = Spans(lead_in=lead_in, controlled=controlled, settle=settle, averages=averages)
    spans.periods(config.flow.control_period)
    return spans


def _closed(
    output: Path,
    release: Bundle,
    config: Config,
    plant: Literal["wake", "openfoam"],
    state: Path | None,
    ecu: "LoopEcu | None",
    library: Path | None,
    chosen: Mapping[str, Any],
) -> "RunLog":
    """Run the loop with the ECU in C, or with the ECU in Python if `ecu` is None. The controller of the ECU in Python
    is the C library; without a library, ONNX Runtime computes the controller's steps. `chosen` are further arguments of
    `run_closed_loop`."""
    from can_bridge.wire.messages import Mode
    from ecu.in_c.host_library import open_library
    from firmware_sim.bench.closed_loop import run_closed_loop
    from firmware_sim.runs.metadata import RunOrigin
    from firmware_sim.runs.run_page.report import write_report
    from wake.plants import open_plant

    controller = None
    if ecu is not None:
        console.print(f"ECU {ecu.kind}: {ecu.computed_by}")
    elif library is not None:
        controller = open_library(library, release)
        console.print(f"library {library}: {controller.description}")
    command = ("stillwake", *(visible(shlex.quote(word)) for word in sys.argv[1:]))
    start = None if state is None else visible(str(state))
    with progress("periods") as report:
        flow = open_plant(
            plant,
            output,
            chosen["disturbances"].plant(config),
            chosen["spans"].lead_in + chosen["spans"].controlled,
            lambda t, total: report("the wake's start", round(t, 1), total, unit="t_c"),
            start=state,
        )

        def show_period(row: "Row", done: int, total: int) -> None:
            report("closed loop", done, total, f"{Mode(row.mode).name} Cd {row.sample.Cd:.3f}")

        return run_closed_loop(
            output,
            release,
            config,
            **chosen,
            progress_without=lambda done, total: report("without control", done, total),
            origin=RunOrigin.on(date.today(), command=command, start=start),
            ready=lambda total: report("closed loop", 0, total, "starting (first run: compiles)"),
            progress=show_period,
            plant=flow,
            controller=controller,
            ecu=ecu,
            report=write_report,
        )


def _ecu_in_c(kind: str, clock_mhz: float, library: Path | None, release: Bundle, config: Config) -> "LoopEcu":
    from can_bridge.secoc.key import read_secret
    from ecu.in_c.c_ecu import ecu_sources
    from firmware_sim.bench.ecus import check_ecu, loop_ecu

    # Invalid settings raise an error before the library is made.
    secret = read_secret(Path(config.bus.key)) if config.bus.key else None
    check_ecu(kind, clock_mhz)
    if library is None:
        if release.digest != open_release(None).digest:
            raise LibraryError(f"--ecu {kind}: name the bundle's C library with --library (`stillwake export --c`)")
        console.print("making the C library of the shipped model, as `stillwake export --c` does")
    with library_folder(library) as folder:
        sources = ecu_sources(folder, release, config)
    return loop_ecu(kind, sources, clock_mhz=clock_mhz, secret=secret)


def _print(log: "RunLog") -> None:
    """Print a failure, the tables, and then the headline, because a terminal shows the end of the output."""
    from firmware_sim.runs.control import trouble
    from firmware_sim.runs.summary import drag_rows, headline, service_rows

    warning = trouble(log)
    if warning is not None:
        console.print(warning, style="bold red")
    print_table("", "uncontrolled", "controlled", rows=drag_rows(log), title=warning, title_style="bold red")
    print_table("bus and ECU", "", rows=service_rows(log))
    console.print(headline(log))


def exit_with(log: "RunLog", required: float | None) -> None:
    """End the command with an exit status other than 0 if the run failed or did not reach the required reduction."""
    from firmware_sim.runs.control import trouble
    from firmware_sim.runs.summary import summary

    failed = trouble(log) is not None
    if required is not None:
        figures = summary(log)
        reached = (figures["drive"] or figures)["reduction_percent"]
        if failed or reached is None or reached < required:
            measured = "no reduction can be claimed" if reached is None else f"the reduction is {reached:.2f} %"
            console.print(f"--require-reduction {required:g}: not reached, {measured}")
            raise typer.Exit(4)
    if failed:
        raise typer.Exit(3)
