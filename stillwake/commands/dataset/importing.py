"""The command `stillwake dataset import`, which makes a data set from the user's files and from recorded drives."""

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Final, cast

import typer

from contract.config.loading import Loaded
from contract.errors import ConfigError, OutputError
from contract.recording.episode import ForcesClock, PlantFacts
from stillwake.commands.dataset import drives
from stillwake.commands.dataset.inspecting import episodes_table, sensors_line
from stillwake.console import options as shared
from stillwake.console.outputs import check_dataset_name, check_output
from stillwake.console.progress import progress
from stillwake.console.settings import settings
from stillwake.console.terminal import console

if TYPE_CHECKING:
    from contract.recording.dataset import Dataset, Role

_ROLES: Final = ("train", "test", "extended", "controlled")
_SAME: Final = 0.02
"""Largest relative difference at which dynamic pressures count as equal. The speed on the bus has an error of 1 %."""
_FLOW: Final = ("flow.control_period", "flow.action_limit", "flow.reynolds")
"""Settings that describe the plant of the data. Without flow.reynolds, the Reynolds number is unknown."""

Files = Annotated[
    list[str] | None, typer.Argument(metavar="ROLE=FILE", help="A role and its file; see above.", show_default=False)
]
Asymmetric = Annotated[bool, typer.Option("--asymmetric", help="Body or jets are not symmetric about y = 0.")]
References = Annotated[
    list[str], typer.Option(help="Number that means 1 (repeatable); see above.", metavar="NAME=NUMBER[UNIT]")
]
Renamed = Annotated[list[str], typer.Option("--map", help="Column with another name, e.g. Cd=drag (repeatable).")]
Forces = Annotated[list[str], typer.Option(help="Table with the Cd and Cl of logs (repeatable).", metavar="[LOG=]FILE")]
Clock = Annotated[ForcesClock | None, typer.Option(help="Clock of the times in --forces; see above.")]
Zone = Annotated[str, typer.Option(help="Zone of logs in local time: Europe/Berlin, +02:00.", show_default=False)]


def import_(
    output: Annotated[Path, typer.Argument(help="HDF5 data set to write.")],
    layout: Annotated[Path, typer.Option(help="CSV file with the sensors: name,x,y and, if known, base (0 or 1).")],
    files: Files = None,
    asymmetric: Asymmetric = False,
    reference: References = [],  # noqa: B006
    rename: Renamed = [],  # noqa: B006
    forces: Forces = [],  # noqa: B006
    forces_clock: Clock = None,
    forces_shift: Annotated[float, typer.Option(help="Seconds to add to the times of --forces.")] = 0.0,
    log_zone: Zone = "",
    channel: Annotated[list[str], typer.Option(help="Channel of a log to read (repeatable).")] = [],  # noqa: B006
    fill: Annotated[int, typer.Option(help="Longest gap that is filled, in control periods.", min=0)] = 2,
    split: Annotated[bool, typer.Option("--split", help="Begin a new episode after a gap longer than --fill.")] = False,
    overwrite: shared.Overwrite = False,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Make a data set from your own files, or from recorded drives.

    Tables (.csv), arrays (.npz, .h5, .nc, .mat) and cases of OpenFOAM are read.

    Give each file together with the role of its episode: train=FILE and test=FILE (training needs both roles),
    extended=FILE (forcing outside the range of training) or controlled=FILE (recorded under a controller). The episode
    gets the file's name. Two settings must be given on the command line or in a TOML file: --set
    flow.control_period=0.2, the time between two rows in t_c, and --set flow.action_limit=0.075, the largest action in
    U_inf W. Give flow.reynolds if the Reynolds number is known.

    Lengths are in W, speeds in U_inf, times in W / U_inf. A table has the columns action, Cd and Cl, and one column for
    the Cp of each sensor, under the sensor's name in --layout. A file of arrays may have one array Cp of shape (steps,
    sensors) instead. A column or array t is optional. The number initial_action, the action before the first row, is
    also optional (otherwise 0). Row k has the measurements at t_k and the action commanded at t_k. If the numbers of a
    file have a unit, state which number in the file means 1: --reference Cp=240Pa (rho U_inf^2 / 2), t=5ms, Cd=40N, or
    Cd=-1 for the opposite sign.

    A log of the CAN bus has commands and the pressures of the four sensors in --layout, in the order of the message;
    its drag and lift come from --forces. Logs are .log, .asc, .blf, .trc, .mf4, .mcap, python-can's .csv and .db, also
    packed as .gz. Cp is computed with the vehicle's speed in the log. operating_point gives the body's width, and the
    speed if the log has no speed. --forces LOG=FILE is for one log. --forces-clock states the unit and the start of the
    times in the files of forces: s on the log's clock (log), s since the log's first pressure (start), or t_c since
    that pressure (t_c). A file whose time column is named 't [t_c]' needs no --forces-clock.

    Nothing is written unless every file is valid. docs/how-to/use-your-own-data.md and
    docs/how-to/train-from-a-can-log.md have examples.
    """
    from can_bridge.logs.log_reader import is_log
    from contract.recording.dataset import write
    from contract.recording.importing.csv_table import read_sensors
    from contract.recording.importing.source_file import references_of

    roles, notes = roles_of(files or []), list[str]()
    if os.path.realpath(output) in map(os.path.realpath, [layout, *(path for path, _ in roles)]):
        raise OutputError(f"{output} is one of the files to read; give another name")
    check_output(output, overwrite=overwrite)
    check_dataset_name(output)
    references, renamed = references_of(reference), dict(shared.pairs(rename, "Cd=drag_coefficient"))
    logs = [path for path, _ in roles if is_log(path)]
    zone, loaded = drives.zone_of(log_zone), settings("dataset import", given, uses=(*drives.USES, *_FLOW))
    only_logs = any((split, forces, forces_clock, forces_shift, channel, zone)) or loaded.in_overrides - set(_FLOW)
    if only_logs and not logs:
        raise ConfigError(
            "--forces, --split, --channel, --log-zone and settings outside flow are for CAN logs; no log is given"
        )
    reader = drives.DriveReader(
        fill=fill,
        split=split,
        names={name: column for name, column in renamed.items() if name in drives.FORCES_NAMES},
        references=references,
        clock=forces_clock,
        shift_s=forces_shift,
        channels=channel,
        zone=zone,
        loaded=loaded,
        facts=_facts(loaded),
        layout=read_sensors(layout, symmetric=not asymmetric, told=_teller(notes)),
        forces=drives.forces_of(logs, forces),
    )
    made = _assembled(roles, reader, renamed, notes)
    write(output, made)
    _print(made, notes)
    console.print(f"wrote {output}; next: stillwake dataset inspect {quote(str(output))}")


def roles_of(texts: list[str]) -> "list[tuple[Path, Role]]":
    """Split the texts ROLE=FILE into files and roles, ordered by role."""
    found = [(Path(file), role) for role, file in shared.pairs(texts, "train=sweep.csv", _ROLES, repeated=True)]
    return [(path, cast("Role", role)) for path, role in sorted(found, key=lambda one: _ROLES.index(one[1]))]


def _facts(loaded: Loaded) -> PlantFacts:
    flow = loaded.config.flow
    for name, example in (("flow.control_period", "0.2"), ("flow.action_limit", "0.075")):
        if name not in loaded.given:
            raise ConfigError(f"{name}: the files do not state it; give it as in --set {name}={example}")
    reynolds = flow.reynolds if "flow.reynolds" in loaded.given else None
    return PlantFacts(control_period=flow.control_period, action_limit=flow.action_limit, reynolds=reynolds)


def _teller(notes: list[str]) -> Callable[[Path, str], None]:
    """Return a function that adds a note on a file to `notes`, which are printed for the user."""
    return lambda path, note: notes.append(f"note: {path}: {note}")


def _assembled(
    roles: "list[tuple[Path, Role]]", reader: drives.DriveReader, renamed: dict[str, str], notes: list[str]
) -> "Dataset":
    from contract.recording.importing.assemble import EpisodeSource, assemble

    sources: list[EpisodeSource] = []
    names, is_local = drives.names_of(list(reader.forces)), False
    with progress("files") as report:
        for number, (path, role) in enumerate(roles):
            if path not in reader.forces:
                sources.append(EpisodeSource(path=path, role=role))
                continue
            shown = partial(report, "reading", number, len(roles))
            made, series, log = reader.read(path, names[path], role, shown)
            cp, own = reader.references.get("Cp"), series.dynamic_pressure
            if cp is not None and cp.unit == "Pa" and abs(cp.number / own - 1.0) > _SAME:
                raise ConfigError(f"{cp.option}: Cp of {path} is computed with {own:g} Pa: correct one of these values")
            is_local |= log.is_local
            sources += made
            notes += drives.notes_on(series, log)
        if reader.zone is not None and not is_local:
            raise ConfigError(f"--log-zone {reader.zone}: no log begins in local time")
        # If all files are logs, --map renames t, Cd and Cl only in the files of forces.
        only_logs = len(reader.forces) == len(roles)
        places = {source.path: number for number, source in enumerate(sources)}
        return assemble(
            sources,
            reader.layout,
            reader.facts,
            references=reader.references,
            renamed={name: column for name, column in renamed.items() if not (only_logs and name in reader.names)},
            progress=lambda path: report("assembling", places[path], len(sources), str(path)),
            told=_teller(notes),
        )


def _print(made: "Dataset", notes: list[str]) -> None:
    from contract.recording.findings import asymmetry
    from contract.recording.plausible import implausible

    console.print(episodes_table(made))
    console.print(sensors_line(made.layout))
    for line in (*notes, *(f"note: {text}" for text in (*implausible(made), *asymmetry(made)))):
        console.print(line)
