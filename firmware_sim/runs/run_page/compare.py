"""Several runs as one self-contained HTML page: figures with differences, settings that differ, wakes side by side."""

from collections.abc import Sequence
from pathlib import Path

from firmware_sim.runs import pages
from firmware_sim.runs.control import trouble
from firmware_sim.runs.run_folder import RunFolder
from firmware_sim.runs.run_page.comparison import differing, figure_rows, names_of
from firmware_sim.runs.run_page.inlined import as_json, inlined
from firmware_sim.runs.run_page.report import read_run, wake_of
from firmware_sim.runs.run_page.run_data import run_data
from firmware_sim.runs.run_tables import headline


def write_comparison(folders: Sequence[RunFolder], target: Path) -> Path:
    """Write the page and return its path. Raises StillwakeError if the runs cannot be compared, a folder does not hold
    one, or the page cannot be written."""
    names = names_of([folder.path for folder in folders])
    runs = [read_run(folder) for folder in folders]
    logs = [run.log for run in runs]
    wakes = [wake_of(folder, run.log) for folder, run in zip(folders, runs, strict=True)]
    return pages.write(
        target,
        "compare.html.j2",
        title=f"stillwake: {', '.join(names)}",
        inlined=inlined("compare.js"),
        runs=[
            {
                "name": name,
                "metadata": run.log.metadata,
                "headline": headline(run.log),
                "trouble": trouble(run.log) is not None,
                "picture": pages.data_uri(run.controlled),
                "filmed": wake is not None,
            }
            for name, run, wake in zip(names, runs, wakes, strict=True)
        ],
        figure_rows=figure_rows(logs),
        differing=differing(logs),
        replays=as_json([run_data(log, wake, name) for log, wake, name in zip(logs, wakes, names, strict=True)]),
    )
