"""The commands that close the loop and show what came of it."""

import shlex
import sys
from contextlib import ExitStack
from dataclasses import asdict, replace
from datetime import date
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.progress import Progress, TaskID

from contract.config.controller import CostWeights
from contract.config.loading import Loaded
from contract.config.tree import Config
from contract.controller.calibration import Calibration
from contract.errors import ConfigError, LibraryError, StillwakeError
from contract.release.checks import Bundle
from stillwake.console.claims import claim
from stillwake.console.outputs import check_json, save_json
from stillwake.console.settings import REAL_BUS, WEIGHTS, settings
from stillwake.console.terminal import ConfigFile, JsonFile, Overrides, console, print_table, progress_bar, visible
from stillwake.parts.releases import Library, Trust, describe, open_release

if TYPE_CHECKING:
    from firmware_sim.ecu.stepped import LoopEcu
    from firmware_sim.runs.run_log import RunLog

NOT_IN_CONTROL: Final = 3
"""Exit status of a run that is whole, but in which the ECU latched a fault or control was not held."""
BELOW_REQUIREMENT: Final = 4
"""Exit status of a run that is whole, but did not reach the reduction that was asked for."""

_BUS: Final = (*(name for name in REAL_BUS if name != "bus.channel"), "bus.key", "bus.background")
"""All but the channel: a bus in virtual time has none."""
_USES: Final = ("body", "operating_point", "flow", *_BUS, "ecu", "vehicle")
PYTHON: Final = "python"
ECUS: Final = (PYTHON, "c", "cortex-m7", "cortex-m7-board")
_STARTING: Final = "starting (first run: compiles)"


def run(
    output: Annotated[Path, typer.Argument(help="Run folder to write.")],
    bundle: Annotated[Path | None, typer.Option(help="Release bundle; default: the shipped one.")] = None,
    trust: Trust = None,
    library: Library = None,
    ecu: Annotated[
        str,
        typer.Option(help="ECU that runs: python, c (on this machine) or cortex-m7 (an emulated board)."),
    ] = PYTHON,
    clock_mhz: Annotated[float, typer.Option(help="Clock of the emulated core, MHz.")] = 480.0,
    lead_in: Annotated[float, typer.Option(help="Time without control, t_c.", min=0.2)] = 25.0,
    controlled: Annotated[
        float | None, typer.Option(help="Time with control, t_c; default: 100, or as long as the drive.", min=0.2)
    ] = None,
    settle: Annotated[float, typer.Option(help="Left out of the controlled averages, t_c.", min=0.0)] = 40.0,
    no_averages: Annotated[
        bool, typer.Option("--no-averages", help="Series only: a run of any length, for a quick check.")
    ] = False,
    require_reduction: Annotated[
        float | None,
        typer.Option(help="Exit with status 4 unless wall drag falls by this many percent, in control throughout."),
    ] = None,
    plant: Annotated[str, typer.Option(help="stillwake (own solver) or openfoam (icoFoam; far slower).")] = "stillwake",
    start: Annotated[
        Path | None, typer.Option(help="Flow state to begin from (`develop`); default: the shipped start.")
    ] = None,
    drive: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.csv", help="Drive at speeds that vary: a shipped profile or a file; see above."
        ),
    ] = None,
    fault: Annotated[
        list[str],
        typer.Option(metavar="TEXT", help="Fault on the bus, as NODE:FAULT@START..END (repeatable); see above."),
    ] = [],  # noqa: B006
    disturb: Annotated[
        list[str],
        typer.Option(metavar="TEXT", help="Disturbance of the run, as KIND:PARAMETER=VALUE@START..END (repeatable)."),
    ] = [],  # noqa: B006
    fault_seed: Annotated[int, typer.Option(help="Of what faults and disturbances draw.", min=0)] = 0,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a run that is in the folder.")] = False,
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Close the loop: live wake, pressures on CAN, the bundle's controller on the ECU, jets; in virtual time.

    Exit status 3: the ECU latched a fault, or control was not held while it was requested. Status 4: the reduction
    that --require-reduction asks for was not reached. The run folder is whole in both cases.

    --fault puts a fault on the bus: the node in whose port it is (vehicle or ecu), the fault, and when it acts, in s of
    the run; ecu:drop:probability=0.1@5..10 loses a tenth of what the ECU sends. The faults are drop, burst_loss,
    duplicate, delay, reorder, flip_bits, stuck_at, babble, disconnect, slow_consumer and clock_drift; their parameters
    are in docs/reference/disturbances.md.

    --ecu c runs the whole ECU as its C sources. With --ecu cortex-m7, which cortex-m7-board names as well, they run as
    the firmware of an emulated board, from its reset vector on: frames pass through its CAN controller's registers, and
    modelled cycles are charged as compute time; docs/how-to/board-and-rtos.md has more. Both are of the folder that
    --library names, or of the shipped model.

    --disturb takes the same texts, and what disturbs the run elsewhere: noise:level=0.5 at the transducers,
    reset@5 in the ECU, reynolds=700 in the flow. The kinds are noise, bias, drift, stuck, dead, swap, quantise,
    wire_errors, reset, clock, no_request, reynolds, body, gust, operating_point, action_limit, stuck_jets, speed_scale,
    speed_late, speed_frozen, no_speed and density; their parameters are in docs/reference/disturbances.md.

    --drive gives the vehicle speeds that vary, and first drives without control, to compare the energy: steady-60 to
    steady-140 (percent of operating_point.speed, in tens), steps, ramps, wltc-high, gusty-ramp, or a CSV file with the
    columns t_s and speed_m_per_s. docs/how-to/drive-at-other-speeds.md has more.
    """
    from can_bridge.wire.messages import Mode
    from firmware_sim.bench.closed_loop import run_closed_loop
    from firmware_sim.bench.disturbances import Disturbances, parse_disturbance
    from firmware_sim.bench.run_faults import parse_node_fault
    from firmware_sim.bench.spans import Spans
    from firmware_sim.in_c.library_controller import open_library
    from firmware_sim.runs.metadata import RunOrigin
    from firmware_sim.runs.run_folder import RunFolder
    from firmware_sim.runs.run_log import Row
    from firmware_sim.runs.run_page.report import write_report
    from firmware_sim.runs.summary import summary
    from wake.plant.drive import find_drive
    from wake.plants import open_plant

    if plant not in ("stillwake", "openfoam"):
        raise StillwakeError(f"--plant {plant}: must be stillwake or openfoam")
    if no_averages and require_reduction is not None:
        raise ConfigError("--require-reduction needs averages: leave out --no-averages")
    if require_reduction is not None and not isfinite(require_reduction):
        raise ConfigError(f"--require-reduction {require_reduction}: must be a number of percent")
    if require_reduction is not None and 0.0 < abs(require_reduction) < 1.0:
        percent = f"for {100 * require_reduction:g} % write {100 * require_reduction:g}"
        raise ConfigError(f"--require-reduction {require_reduction:g}: is a number of percent; {percent}")
    if drive is not None and plant != "stillwake":
        raise ConfigError(f"--drive {drive}: needs the own solver, --plant stillwake")
    if ecu not in ECUS:
        raise ConfigError(f"--ecu {ecu}: must be one of {', '.join(ECUS)}")
    disturbances = [*map(parse_node_fault, fault), *map(parse_disturbance, disturb)]
    folder = RunFolder(output)
    claim(output, folder=True)
    folder.check_free(overwrite=overwrite)
    check_json(json_file)
    uses = (*_USES, "mpc", *(["openfoam"] if plant == "openfoam" else []))
    loaded = settings("run", config_file, overrides, uses=uses)
    release = open_release(bundle, trust)
    config, calibration = loaded.config, asked_calibration(loaded, release)
    driven = None if drive is None else find_drive(drive, config.operating_point)
    if driven is not None:
        config = replace(config, flow=driven.substeps(config.flow, config.operating_point))
    if controlled is None:
        controlled = 100.0 if driven is None else driven.duration_s / config.operating_point.convective_time
    # What is refused is refused before a library is made.
    spans = Spans(lead_in=lead_in, controlled=controlled, settle=settle, averages=not no_averages)
    spans.periods(config.flow.control_period)
    console.print(*describe(release), sep="\n")
    if config.ecu.sensor_check.enabled and release.manifest.sensor_estimator is None:
        console.print("sensor check: off, this bundle has no sensor estimator")
    controller, in_c = None, None
    if ecu != PYTHON:
        in_c = _ecu_in_c(ecu, library, release, config, clock_mhz=clock_mhz)
        console.print(f"ECU {ecu}: {in_c.computed_by}")
    elif library is not None:
        controller = open_library(library, release)
        console.print(f"library {library}: {controller.description}")
    waiting = ExitStack()
    bars: list[tuple[Progress, TaskID]] = []

    def show(
        done: float, total: float, note: str = "", description: str = "closed loop", *, at_once: bool = True
    ) -> None:
        # From when there is something to wait for: an error before that is one line, without an empty bar.
        if not bars:
            bar = waiting.enter_context(progress_bar("periods"))
            bars.append((bar, bar.add_task(description, total=None, note="")))
        bar, task = bars[0]
        bar.update(task, description=description, completed=done, total=total, note=note, refresh=at_once)

    def show_period(row: Row, done: int, total: int) -> None:
        show(done, total, f"{Mode(row.mode).name} Cd {row.sample.Cd:.3f}", at_once=False)

    flow = open_plant(
        "openfoam" if plant == "openfoam" else "stillwake",
        output,
        Disturbances(items=tuple(disturbances)).plant(config),
        lead_in + controlled,
        lambda t, total: show(round(t, 1), total, "t_c of the wake's start"),
        start=start,
    )
    with waiting:
        log = run_closed_loop(
            output,
            release,
            config,
            lead_in=lead_in,
            controlled=controlled,
            settle=settle,
            averages=not no_averages,
            drive=driven,
            progress_without=lambda done, total: show(done, total, description="without control", at_once=False),
            calibration=calibration,
            origin=RunOrigin.on(
                date.today(),
                command=("stillwake", *(visible(shlex.quote(word)) for word in sys.argv[1:])),
                start=None if start is None else visible(str(start)),
            ),
            ready=lambda total: show(0, total, _STARTING),
            progress=show_period,
            plant=flow,
            controller=controller,
            faults=disturbances,
            fault_seed=fault_seed,
            ecu=in_c,
            report=write_report,
        )
    save_json(json_file, figures=summary(log), facts=log.metadata.to_tree())
    _print(log)
    console.print(f"wrote {folder.report} and {folder.summary}")
    exit_with(log, require_reduction)


def _ecu_in_c(kind: str, library: Path | None, release: Bundle, config: Config, *, clock_mhz: float) -> "LoopEcu":
    """The bundle's ECU in C, for the vehicle of this run. Raises LibraryError if no library was named, and the bundle
    is not the shipped one; or the library is not the bundle's; StillwakeError if it cannot be compiled, or the settings
    are not for an ECU in C."""
    from firmware_sim.bench.ecus import check_ecu, loop_ecu
    from firmware_sim.in_c.c_ecu import ecu_sources
    from stillwake.parts.c_release import library_folder

    # What is refused is refused before the library is made.
    if config.bus.key:
        raise ConfigError(f"bus.key: --ecu {kind} has no authentication; leave it empty, or take --ecu {PYTHON}")
    check_ecu(kind, clock_mhz)
    if library is None:
        if release.digest != open_release(None, None).digest:
            raise LibraryError(f"--ecu {kind}: name the bundle's C library with --library (`stillwake export --c`)")
        console.print("making the C library of the shipped model, as `stillwake export --c` does")
    with library_folder(library) as folder:
        sources = ecu_sources(folder, release, config)
    return loop_ecu(kind, sources, clock_mhz=clock_mhz)


def report(
    folders: Annotated[list[Path], typer.Argument(metavar="FOLDER", help="Folders written by `run`: one, or several.")],
    output: Annotated[
        Path | None, typer.Option(help="Page to write (.html); needed for several runs. One run's is in its folder.")
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="Also write the run as one picture (.png, .pdf, .svg).")] = None,
    csv: Annotated[Path | None, typer.Option(help="Also write the series as CSV, units in the header.")] = None,
) -> None:
    """Write the HTML page of a finished run again, or of several runs side by side.

    The page needs no other file and no network. Its slider moves through the recorded wake.
    """
    from firmware_sim.runs.run_folder import RunFolder
    from firmware_sim.runs.run_log import load
    from firmware_sim.runs.run_page.compare import write_comparison
    from firmware_sim.runs.run_page.report import write_picture, write_report
    from firmware_sim.runs.series_csv import write_csv
    from wake.pictures.drawing import check_suffix

    if output is not None and output.suffix.lower() != ".html":
        raise ConfigError(f"--output {output}: must be a file ending in .html")
    runs = [RunFolder(folder) for folder in folders]
    if len(runs) > 1:
        if output is None:
            raise ConfigError(f"{len(runs)} runs: name the page that compares them with --output FILE.html")
        if picture is not None or csv is not None:
            raise ConfigError("--picture and --csv are of one run: give one folder")
        console.print(f"wrote {write_comparison(runs, output)}")
        return
    if picture is not None:
        check_suffix(picture)
    console.print(f"wrote {write_report(runs[0], output)}")
    if picture is not None:
        write_picture(runs[0], picture)
        console.print(f"wrote {picture}")
    if csv is not None:
        write_csv(csv, load(runs[0].series))
        console.print(f"wrote {csv}")


def asked_calibration(loaded: Loaded, release: Bundle) -> Calibration:
    """What the ECU runs with: the bundle's weights with those of the user, the vehicle's bounds and delay. Raises
    ConfigError for a weight out of the limits, or another setting of the optimiser: it is fixed in the bundle."""
    from firmware_sim.ecu.calibrating import limits_of, release_calibration

    calibration = replace(release_calibration(release, loaded.config), weights=cost_weights(loaded, release))
    limits_of(release, loaded.config).check(calibration)
    return calibration


def cost_weights(loaded: Loaded, release: Bundle) -> CostWeights:
    """The bundle's weights, with those that the user gave in their place. Raises ConfigError for another setting of the
    optimiser: it is fixed in the bundle."""
    built, given = asdict(release.manifest.mpc), asdict(loaded.config.mpc)
    for name in sorted(item for item in loaded.given if item.startswith("mpc.") and not item.startswith(WEIGHTS)):
        key = name.removeprefix("mpc.")
        if name in loaded.in_overrides or given[key] != built[key]:
            raise ConfigError(
                f"{name} = {given[key]}: fixed when the bundle was exported, to {built[key]}; make another bundle with "
                f"`stillwake export MODEL BUNDLE --set {name}={given[key]}`"
            )
    asked = [name.removeprefix(f"{WEIGHTS}.") for name in loaded.given if name.startswith(f"{WEIGHTS}.")]
    return replace(release.manifest.mpc.weights, **{name: given["weights"][name] for name in asked})


def _print(log: "RunLog") -> None:
    """What went wrong, the tables, and the headline last, where a terminal is read first."""
    from firmware_sim.runs.control import trouble
    from firmware_sim.runs.run_tables import drag_rows, headline, service_rows

    warning = trouble(log)
    if warning is not None:
        console.print(warning, style="bold red")
    print_table("", "uncontrolled", "controlled", rows=drag_rows(log), title=warning, title_style="bold red")
    print_table("bus and ECU", "", rows=service_rows(log))
    console.print(headline(log))


def exit_with(log: "RunLog", required: float | None) -> None:
    """End with the status that says whether the run is what was asked for."""
    from firmware_sim.runs.control import trouble
    from firmware_sim.runs.summary import summary

    failed = trouble(log) is not None
    if required is not None:
        figures = summary(log)
        reached = (figures["drive"] or figures)["reduction_percent"]
        if failed or reached is None or reached < required:
            measured = "no reduction can be claimed" if reached is None else f"it is {reached:.2f} %"
            console.print(f"--require-reduction {required:g}: not reached, {measured}")
            raise typer.Exit(BELOW_REQUIREMENT)
    if failed:
        raise typer.Exit(NOT_IN_CONTROL)
