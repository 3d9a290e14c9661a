"""The command that reports on finished runs, and writes runs, logs and data sets in other formats."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated
from urllib.parse import quote

import typer

from contract.atomic import leads_to
from contract.errors import ConfigError
from stillwake.console.outputs import DATASET_SUFFIXES, check_frames, check_output, claim, print_written
from stillwake.console.terminal import console, listed

if TYPE_CHECKING:
    from collections.abc import Callable

    from firmware_sim.runs.run_log import RunFolder

Sources = Annotated[
    list[Path], typer.Argument(metavar="FOLDER|FILE", help="Folders written by `run`; or one log, or one data set.")
]
Outputs = Annotated[
    list[Path], typer.Option("--output", help="File; its ending sets the format (repeatable).", metavar="FILE")
]


def report(sources: Sources, outputs: Outputs = []) -> None:  # noqa: B006
    """Write the HTML page of a finished run, a page that compares several runs, or a run in other formats.

    The page needs no other file and no network. A slider on the page moves through the recorded wake. Without --output
    the page is written into the run's folder. The ending of --output gives the format: .png, .pdf or .svg for one
    picture, .csv for the series with units in the header, .mf4 (ASAM MDF) or .mcap for frames and named signals with
    units.

    A log of the bus in any supported format becomes an .mf4 or .mcap file with the same signals. A data set (.h5)
    becomes netCDF (.nc), one file for each episode; if there are several episodes, each episode's name is added to the
    file's name.

    stillwake report runs/demo --output demo.mf4 --output demo.mcap
    """
    from can_bridge.logs.log_reader import is_log

    if not sources[0].is_dir() and (sources[0].suffix.lower() in DATASET_SUFFIXES or is_log(sources[0])):
        (_of_log if is_log(sources[0]) else _of_dataset)(sources, outputs)
        return
    from firmware_sim.runs.run_log import RunFolder
    from firmware_sim.runs.run_page.report import write_comparison, write_report

    runs = [RunFolder(folder) for folder in sources]
    if len(runs) > 1:
        if not outputs:
            raise ConfigError(f"to compare {len(runs)} runs, name the page to write: --output FILE.html")
        if [one.suffix.lower() for one in outputs] != [".html"]:
            raise ConfigError(f"--output {outputs[-1]}: must be one .html file; other formats are for a single run")
        claim(outputs[0])
        console.print(f"wrote {write_comparison(runs, outputs[0])}")
        return
    writers = [(one, _writer(runs[0], one)) for one in outputs]
    for path in outputs or (runs[0].report,):
        claim(path)
    for output, write in writers:
        print_written(output, write())
    if not outputs:
        console.print(f"wrote {write_report(runs[0])}")


def _of_dataset(sources: list[Path], outputs: list[Path]) -> None:
    from contract.recording.dataset import read
    from contract.recording.netcdf import write_netcdf

    if len(sources) > 1 or [one.suffix.lower() for one in outputs] != [".nc"]:
        raise ConfigError(f"{sources[0]} is a data set: give one data set and one --output FILE.nc")
    found = read(sources[0])
    endings = [f"_{quote(one.name, safe=' ')}" if len(found.episodes) > 1 else "" for one in found.episodes]
    paths = [outputs[0].with_stem(f"{outputs[0].stem}{ending}") for ending in endings]
    # An existing .nc file may be a measurement, so it is not replaced, unlike a run's page.
    for path in paths:
        check_output(path, overwrite=None)
    for path, episode in zip(paths, found.episodes, strict=True):
        write_netcdf(path, episode, found.layout)
        print_written(path, None)


def _of_log(sources: list[Path], outputs: list[Path]) -> None:
    from can_bridge.logs.log_reader import CanLog
    from can_bridge.tools.measurement import write_measurement

    if len(sources) > 1 or not outputs:
        raise ConfigError(f"{sources[0]} is a log: give one log, and --output FILE.mf4 or FILE.mcap")
    for output in outputs:
        if output.exists() and output.samefile(sources[0]):
            raise ConfigError(f"--output {output} is the file to read; give another name")
        check_frames(output)
    for output in outputs:
        log = CanLog(sources[0])
        print_written(output, write_measurement(output, log))
    if events := listed(log.events):
        console.print(f"{sources[0]}: {log.messages} frames; lines of other kinds: {events}")


def _writer(run: "RunFolder", output: Path) -> "Callable[[], object]":
    """Return the function that writes an output. Raises ConfigError if no format has the ending of its name."""
    from can_bridge.tools.measurement import MEASUREMENTS
    from firmware_sim.runs.run_log import load
    from firmware_sim.runs.run_page.measurement import write_csv, write_run
    from firmware_sim.runs.run_page.report import write_picture, write_report
    from wake.pictures.drawing import PICTURES

    if leads_to(output) in map(leads_to, (run.uncontrolled_picture, run.controlled_picture)):
        raise ConfigError(f"--output {output} is one of the run's own pictures; give another name")
    match output.suffix.lower():
        case ".html":
            return lambda: write_report(run, output)
        case ".csv":
            return lambda: write_csv(output, load(run.series))
        case suffix if suffix in PICTURES:
            return lambda: write_picture(run, output)
        case suffix if suffix in MEASUREMENTS:
            check_frames(output)
            return lambda: write_run(output, run)
    raise ConfigError(f"--output {output}: must end in .html, .csv, {', '.join((*PICTURES, *MEASUREMENTS))}")
