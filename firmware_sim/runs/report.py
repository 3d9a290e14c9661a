"""A run as one self-contained HTML page: table, time series, wake before and after, settings."""

from dataclasses import asdict
from pathlib import Path

from contract.atomic import replacing
from contract.errors import StillwakeError
from firmware_sim.runs import pages, run_log
from firmware_sim.runs.metadata import RunMetadata
from firmware_sim.runs.pictures import overview_figure, series_figure
from firmware_sim.runs.run_folder import RunFolder
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.tables import drag_rows, headline, service_rows


def write_report(folder: RunFolder) -> Path:
    """Write the page into a run folder and return its path.

    Raises:
        StillwakeError: if the folder does not hold a run, or cannot be written.
    """
    log, uncontrolled, controlled = _read(folder)
    page = pages.render(
        "report.html.j2",
        run=log.metadata,
        headline=headline(log),
        drag_rows=drag_rows(log),
        service_rows=service_rows(log),
        series_picture=pages.data_uri(pages.png_of(series_figure(log))),
        uncontrolled_picture=pages.data_uri(uncontrolled),
        controlled_picture=pages.data_uri(controlled),
        settings=_settings(log.metadata),
    )
    with replacing(folder.report) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return folder.report


def write_picture(folder: RunFolder, target: Path) -> None:
    """Write the run as one PNG: the wake before and under control, drag and action over time.

    Raises:
        StillwakeError: if the folder does not hold a run, or the target cannot be written.
    """
    figure = overview_figure(*_read(folder))
    with replacing(target) as temporary:
        figure.savefig(temporary, format="png")


def _read(folder: RunFolder) -> tuple[RunLog, bytes, bytes]:
    """The series and the pictures before and under control."""
    log = run_log.load(folder.series)
    try:
        return log, folder.uncontrolled_picture.read_bytes(), folder.controlled_picture.read_bytes()
    except OSError as error:
        raise StillwakeError(f"{error.filename}: {error.strerror}") from error


def _settings(run: RunMetadata) -> list[str]:
    """One line each."""
    mpc = asdict(run.mpc)
    weights = mpc.pop("weights")
    return [
        *(f"{name}: {value}" for name, value in mpc.items()),
        *(f"weight {name}: {value}" for name, value in weights.items()),
        *(f"ecu {name}: {value}" for name, value in asdict(run.config.ecu).items()),
        *(f"{name} {value}" for name, value in run.versions.items()),
    ]
