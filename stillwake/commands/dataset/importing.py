"""`stillwake dataset import`: files of one's own, and recorded drives, become a data set."""

import os
from pathlib import Path
from typing import Annotated, Final

import typer

from contract.errors import ConfigError, DatasetError, OutputError
from contract.recording.facts import ForcesClock
from stillwake.commands.dataset.drives import (
    USES,
    DriveOptions,
    forces_of,
    is_log,
    names_of,
    notes_on,
    read_drive,
    scales_of,
    zone_of,
)
from stillwake.commands.dataset.listing import episodes_table, sensors_line
from stillwake.console.outputs import Overwrite, check_dataset_name, check_output
from stillwake.console.progress import now_and_then
from stillwake.console.settings import settings
from stillwake.console.terminal import ConfigFile, Overrides, console, progress_bar

LOGS: Final = "Recorded drives"
SAME: Final = 0.02
"""Relative difference up to which two dynamic pressures are one: a speed on the bus has an error of one per cent."""


def import_(
    output: Annotated[Path, typer.Argument(help="HDF5 data set to write.")],
    sensors: Annotated[Path, typer.Option(help="CSV file with the sensors: name,x,y and, if known, base (0 or 1).")],
    period: Annotated[float, typer.Option(help="Control period in t_c = W / U_inf: the time between two rows.")],
    limit: Annotated[float, typer.Option(help="Largest action, in U_inf W.")],
    train: Annotated[list[Path], typer.Option(help="File to fit the model to (repeatable).")] = [],  # noqa: B006
    test: Annotated[list[Path], typer.Option(help="File to judge the model on (repeatable).")] = [],  # noqa: B006
    extended: Annotated[
        list[Path], typer.Option(help="File with forcing outside the range of training, kept aside (repeatable).")
    ] = [],  # noqa: B006
    controlled: Annotated[
        list[Path], typer.Option(help="File recorded under a controller, kept aside (repeatable).")
    ] = [],  # noqa: B006
    reynolds: Annotated[float | None, typer.Option(help="U_inf W / nu, if it is known.")] = None,
    asymmetric: Annotated[
        bool, typer.Option("--asymmetric", help="Body or jets are not their own mirror image in y = 0.")
    ] = False,
    dynamic_pressure: Annotated[
        float | None, typer.Option(help="rho U_inf^2 / 2 in Pa, if the files hold p - p_inf in Pa in place of Cp.")
    ] = None,
    reference: Annotated[
        list[str],
        typer.Option(
            help="What 1 of a series or sensor is in files that have it in a unit: t=5ms, Cd=40N; Cd=-1 for the other "
            "sign (repeatable).",
            metavar="NAME=NUMBER[UNIT]",
        ),
    ] = [],  # noqa: B006
    rename: Annotated[
        list[str], typer.Option("--map", help="NAME=COLUMN where a file has another name, e.g. Cd=drag (repeatable).")
    ] = [],  # noqa: B006
    forces: Annotated[
        list[str],
        typer.Option(
            help="Cd and Cl of CAN logs: a table with t, Cd and Cl; LOG=FILE for one log (repeatable).",
            metavar="[LOG=]FILE",
            rich_help_panel=LOGS,
        ),
    ] = [],  # noqa: B006
    forces_clock: Annotated[
        ForcesClock | None,
        typer.Option(
            help="Times of --forces: s on the log's clock, s since its first pressure, or t_c since then. "
            "Not needed where a table calls its column 't [t_c]'.",
            rich_help_panel=LOGS,
        ),
    ] = None,
    forces_shift: Annotated[
        float, typer.Option(help="Seconds to add to the times of --forces.", rich_help_panel=LOGS)
    ] = 0.0,
    forces_map: Annotated[
        list[str],
        typer.Option(
            help="NAME=COLUMN in a table of forces; NAME is t, Cd or Cl (repeatable).",
            rich_help_panel=LOGS,
        ),
    ] = [],  # noqa: B006
    log_zone: Annotated[
        str,
        typer.Option(
            help="Time zone of logs that begin in local time (BLF, TRC, MDF, candump -t A), such as Europe/Berlin or "
            "+02:00.",
            show_default=False,
            rich_help_panel=LOGS,
        ),
    ] = "",
    channel: Annotated[
        list[str],
        typer.Option(
            help="Channel to read of a log that has several with these messages (repeatable).",
            rich_help_panel=LOGS,
        ),
    ] = [],  # noqa: B006
    fill: Annotated[
        int,
        typer.Option(
            help="Longest gap in a log, in control periods, that is filled on a straight line.",
            min=0,
            rich_help_panel=LOGS,
        ),
    ] = 2,
    split: Annotated[
        bool,
        typer.Option(
            "--split", help="Make an episode of each side of a longer gap; refused without.", rich_help_panel=LOGS
        ),
    ] = False,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
    overwrite: Overwrite = False,
) -> None:
    """Make a data set of your own files, or of recorded drives.

    Tables (.csv), arrays (.npz, .h5, .nc, .mat) and cases of OpenFOAM are read.

    Lengths are in W, speeds in U_inf, times in W / U_inf. A table has the
    series action, Cd, Cl, and a column for every sensor's Cp,
    under its name in --sensors; files of arrays may have one array Cp of
    shape (steps, sensors) instead. A series t is optional, and so is
    initial_action, the action before the first row (otherwise 0). Row k has
    what was measured at t_k and the action commanded then.

    A log of the CAN bus (.log, .asc, .blf, .trc, .mf4, python-can's .csv and
    .db, packed ones with .gz) has pressures and commands of the four sensors
    in --sensors, in the order of the message; its drag and lift come from
    --forces. The vehicle's speed in the log makes Cp; without it, and for the
    body's width, operating_point in --config or --set does. docs/how-to/train-from-a-can-log.md has examples.

    --train, --test, --extended and --controlled set what an episode is for;
    training needs the first two. The file's name becomes the episode's. Nothing
    is written unless every file fits. docs/how-to/use-your-own-data.md has
    examples.
    """
    from contract.recording.dataset import Role, write
    from contract.recording.facts import PlantFacts
    from contract.recording.findings import asymmetry
    from contract.recording.importing.assemble import Source, assemble
    from contract.recording.importing.sensor_table import read_sensors
    from contract.recording.importing.units import references_of
    from contract.recording.plausible import implausible

    files: list[tuple[Path, Role]] = [
        *((path, "train") for path in train),
        *((path, "test") for path in test),
        *((path, "extended") for path in extended),
        *((path, "controlled") for path in controlled),
    ]
    logs = [path for path, _ in files if is_log(path)]
    for log in logs:
        if logs.count(log) > 1:
            raise DatasetError(
                f"{log}: given twice; an episode has one role, so cut the log in two if you have no other"
            )
    for path in (*(path for path, _ in files), sensors):
        if os.path.realpath(output) == os.path.realpath(path):
            raise OutputError(f"{output}: is one of the files to read; give another name")
    check_output(output, overwrite=overwrite)
    check_dataset_name(output)
    references = references_of(reference)
    options = DriveOptions(
        fill=fill,
        split=split,
        forces=forces,
        names=renamed(forces_map, "--forces-map"),
        references=references,
        clock=forces_clock,
        shift_s=forces_shift,
        channels=channel,
        zone=zone_of(log_zone),
    )
    loaded = settings("dataset import", config_file, overrides, uses=USES)
    facts = PlantFacts(control_period=period, action_limit=limit, reynolds=reynolds)
    if not logs and (options.given or loaded.in_overrides):
        raise ConfigError("--forces, --split, --channel, --log-zone and settings are for CAN logs, and no file is one")
    log_forces, names = forces_of(logs, forces), names_of(logs)
    notes: list[str] = []
    has_local_start = False

    def told(path: Path, note: str) -> None:
        notes.append(f"note: {path}: {note}")

    layout = read_sensors(sensors, symmetric=not asymmetric, told=told)
    with progress_bar("files") as bar:
        task = bar.add_task("reading", total=len(files), note="")
        read = 0
        show = now_and_then(lambda what: bar.update(task, completed=read, note=str(what)))
        sources: list[Source] = []
        for path, role in files:
            if not is_log(path):
                sources.append(Source(path=path, role=role))
                continue
            drive = read_drive(
                path, names[path], role, log_forces[path], layout, scales_of(facts, loaded), options, loaded, show
            )
            _check_pressure(path, drive.report.dynamic_pressure, dynamic_pressure)
            read += 1
            sources += drive.sources
            notes += notes_on(drive)
            has_local_start = has_local_start or drive.log.is_local
        if log_zone and not has_local_start:
            raise ConfigError(f"--log-zone {log_zone}: no log begins in local time")

        def reading(path: Path) -> None:
            nonlocal read
            show(path)
            read += 1

        made = assemble(
            sources,
            layout,
            facts,
            dynamic_pressure=dynamic_pressure,
            references=references,
            renamed=renamed(rename, "--map"),
            progress=reading,
            told=told,
        )
        write(output, made)
    notes += [f"note: {text}" for text in (*implausible(made), *(item.text for item in asymmetry(made)))]
    console.print(episodes_table(made))
    console.print(sensors_line(layout))
    for line in notes:
        console.print(line)
    console.print(f"wrote {output}; next: stillwake dataset check {output}")


def _check_pressure(log: Path, own: float, given: float | None) -> None:
    """Refuse one that contradicts a log's."""
    if given is not None and abs(given / own - 1.0) > SAME:
        raise ConfigError(
            f"--dynamic-pressure {given:g}: {log} has {own:g} Pa, by which its pressures are divided: put one of the "
            f"two right"
        )


def renamed(texts: list[str], option: str) -> dict[str, str]:
    """Pairs of NAME=COLUMN; raises ConfigError for anything else."""
    pairs = {}
    for text in texts:
        name, separator, column = text.partition("=")
        if not (separator and name.strip() and column.strip()):
            raise ConfigError(f"{option} {text}: write NAME=COLUMN, such as Cd=drag_coefficient")
        pairs[name.strip()] = column.strip()
    return pairs
