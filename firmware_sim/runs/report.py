"""A run as one self-contained HTML page: verdict, tables, time series, wake before and after, settings."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from contract.atomic import replacing
from contract.config import loading
from contract.errors import StillwakeError
from firmware_sim.runs import pages, run_log
from firmware_sim.runs.control import trouble
from firmware_sim.runs.metadata import RunMetadata
from firmware_sim.runs.pictures import NARROW, latency_figure, overview_figure, series_figure
from firmware_sim.runs.run_folder import RunFolder
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.statistics import NoAverages, averages
from firmware_sim.runs.tables import drag_rows, headline, service_rows
from wake.pictures.drawing import check_suffix

_UNUSED: Final = ("forcing", "model", "train", "mpc")
"""Sections of the settings that a run does not read; the bundle has its own `mpc`."""


def write_report(folder: RunFolder) -> Path:
    """Write the page into a run folder and return its path.

    Raises:
        StillwakeError: if the folder does not hold a run, or cannot be written.
    """
    log, uncontrolled, controlled = _read(folder)
    page = pages.render(
        "report.html.j2",
        run=log.metadata,
        trouble=trouble(log),
        headline=headline(log),
        drag_rows=drag_rows(log),
        averaged=not isinstance(averages(log), NoAverages),
        service_rows=service_rows(log),
        series_picture=pages.data_uri(pages.png_of(series_figure(log))),
        narrow_series_picture=pages.data_uri(pages.png_of(series_figure(log, NARROW))),
        latency_picture=pages.data_uri(pages.png_of(latency_figure(log))),
        uncontrolled_picture=pages.data_uri(uncontrolled),
        controlled_picture=pages.data_uri(controlled),
        settings=settings_lines(log.metadata),
    )
    with replacing(folder.report) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return folder.report


def write_picture(folder: RunFolder, target: Path) -> None:
    """Write the run as one picture: the wake before and under control, drag and action over time.

    The file says in its description of which bundle the run was.

    Raises:
        ConfigError: if the target's name ends in no format of pictures.
        StillwakeError: if the folder does not hold a run, or the target cannot be written.
    """
    check_suffix(target)
    log, uncontrolled, controlled = _read(folder)
    kind = target.suffix[1:].lower()
    # PDF has fields of its own; PNG and SVG know a description.
    described = {"Subject" if kind == "pdf" else "Description": f"stillwake bundle {log.metadata.digest}"}
    with replacing(target) as temporary:
        overview_figure(log, uncontrolled, controlled).savefig(temporary, format=kind, metadata=described)


def settings_lines(run: RunMetadata) -> list[str]:
    """Every setting of a run as in TOML with dots, the optimiser's as in the bundle, weights as in force, versions."""
    used = {name: value for name, value in loading.to_tree(run.config).items() if name not in _UNUSED}
    tree = run.to_tree()
    return [
        *(f"{name} = {value}" for name, value in _leaves(used)),
        *(f"mpc.{name} = {value}" for name, value in _leaves(tree["mpc"] | {"weights": tree["weights"]})),
        *(f"{name} {value}" for name, value in run.versions.items()),
    ]


def _read(folder: RunFolder) -> tuple[RunLog, bytes, bytes]:
    """The series and the pictures before and under control."""
    log = run_log.load(folder.series)
    try:
        return log, folder.uncontrolled_picture.read_bytes(), folder.controlled_picture.read_bytes()
    except OSError as error:
        raise StillwakeError(f"{error.filename}: {error.strerror}") from error


def _leaves(tree: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value
