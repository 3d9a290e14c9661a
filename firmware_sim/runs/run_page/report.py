"""The report of a run as one self-contained HTML page: verdict, tables, series, recorded wake, settings."""

from pathlib import Path
from typing import NamedTuple

from contract.atomic import replacing
from contract.errors import StillwakeError
from firmware_sim.runs import pages, run_log, wake_stills
from firmware_sim.runs.control import trouble
from firmware_sim.runs.metadata import settings_lines
from firmware_sim.runs.pictures import overview_figure
from firmware_sim.runs.run_folder import RunFolder
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.run_page.inlined import as_json, inlined
from firmware_sim.runs.run_page.run_data import run_data
from firmware_sim.runs.run_tables import drag_rows, headline, service_rows
from firmware_sim.runs.statistics import NoAverages, averages
from firmware_sim.runs.wake_stills import WakeStills
from wake.pictures.drawing import check_suffix


class ReadRun(NamedTuple):
    """The series of a run, and the pictures of its wake before and under control, as PNG."""

    log: RunLog
    uncontrolled: bytes
    controlled: bytes


def read_run(folder: RunFolder) -> ReadRun:
    """Read the files for every page of a run. Raises StillwakeError if a file is missing or damaged."""
    log = run_log.load(folder.series)
    try:
        return ReadRun(log, folder.uncontrolled_picture.read_bytes(), folder.controlled_picture.read_bytes())
    except OSError as error:
        raise StillwakeError(f"{error.filename}: {error.strerror}") from error


def write_report(folder: RunFolder, target: Path | None = None) -> Path:
    """Write the page of a run into its folder, or to `target`, and return the page's path. Raises StillwakeError if the
    folder contains no run, one of its files is damaged, or the page cannot be written."""
    # This import is inside the function, because it imports all of python-can's readers, which takes a second.
    from firmware_sim.runs.run_page.bus_messages import BUS_HEADS, bus_rows

    run = read_run(folder)
    log = run.log
    wake, messages = wake_of(folder, log), bus_rows(folder, log)
    return pages.write(
        folder.report if target is None else target,
        "report.html.j2",
        title=f"stillwake run of {log.metadata.origin.day}",
        inlined=inlined("report.js"),
        run=log.metadata,
        trouble=trouble(log),
        headline=headline(log),
        drag_rows=drag_rows(log),
        averaged=not isinstance(averages(log), NoAverages),
        service_rows=service_rows(log),
        bus_heads=BUS_HEADS,
        bus_rows=messages,
        uncontrolled_picture=pages.data_uri(run.uncontrolled),
        controlled_picture=pages.data_uri(run.controlled),
        settings=settings_lines(log.metadata),
        replay=as_json(run_data(log, wake, "")),
    )


def wake_of(folder: RunFolder, log: RunLog) -> WakeStills | None:
    """Read the recorded wake; return None for a folder of an earlier version. Raises StillwakeError if the file is
    damaged, or its times differ from the times of the series."""
    return wake_stills.load(folder.wake, log) if folder.wake.exists() else None


def write_picture(folder: RunFolder, target: Path) -> None:
    """Write the run as one picture: the wake before and under control, and drag and action over time.

    The metadata of the picture contain the bundle's digest. Raises ConfigError if the target's suffix is not a picture
    format; StillwakeError if the folder contains no run, or the target cannot be written.
    """
    check_suffix(target)
    run = read_run(folder)
    kind = target.suffix[1:].lower()
    # PDF has no metadata field for a description, so its field for the subject has the digest.
    described = {"Subject" if kind == "pdf" else "Description": f"stillwake bundle {run.log.metadata.digest}"}
    with replacing(target) as temporary:
        overview_figure(run.log, run.uncontrolled, run.controlled).savefig(temporary, format=kind, metadata=described)
