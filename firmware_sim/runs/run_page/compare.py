"""Several runs as one self-contained HTML page: figures with differences, settings that differ, wakes side by side."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from contract.atomic import replacing
from firmware_sim.runs import pages
from firmware_sim.runs.control import trouble
from firmware_sim.runs.pictures import WIDE
from firmware_sim.runs.run_folder import RunFolder
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.run_page.comparison import differing, figure_rows, names_of
from firmware_sim.runs.run_page.inlined import as_json, inlined
from firmware_sim.runs.run_page.report import read_run, wake_of
from firmware_sim.runs.run_page.run_data import run_data
from firmware_sim.runs.run_tables import headline

_DRAWN: Final = (("Cd", "$C_d$ (wall)"), ("Cl", "$C_l$"), ("action", r"action / $U_\infty W$"))


def write_comparison(folders: Sequence[RunFolder], target: Path) -> Path:
    """Write the page and return its path.

    Raises:
        StillwakeError: if the runs cannot be compared, a folder does not hold one, or the page cannot be written.
    """
    names = names_of([folder.path for folder in folders])
    runs = [read_run(folder) for folder in folders]
    logs = [run.log for run in runs]
    wakes = [wake_of(folder, run.log) for folder, run in zip(folders, runs, strict=True)]
    page = pages.render(
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
        curves_picture=pages.data_uri(pages.png_of(_figure(logs, names))),
        replays=as_json([run_data(log, wake, name) for log, wake, name in zip(logs, wakes, names, strict=True)]),
    )
    with replacing(target) as temporary:
        temporary.write_text(page, encoding="utf-8", errors="backslashreplace")
    return target


def _figure(logs: Sequence[RunLog], names: Sequence[str]) -> Figure:
    """Drag, lift and action since the request, for where no script runs; a run without a request begins at 0."""
    figure = Figure(figsize=(WIDE, 7.0), dpi=100, layout="constrained")
    axes = figure.subplots(len(_DRAWN), 1, sharex=True)
    for place, (log, name) in enumerate(zip(logs, names, strict=True)):
        t = log.series["t"]
        since = t - t[log.enabled_at if log.enabled_at < len(t) else 0]
        for axis, (column, label) in zip(axes, _DRAWN, strict=True):
            axis.plot(since, log.series[column], color=f"C{place}", linewidth=1.0, label=name)
            axis.set_ylabel(label)
    for axis in axes:
        axis.axvline(0.0, color="0.4", linewidth=1.0, linestyle=":")
        axis.grid(alpha=0.25)
    axes[-1].set_xlabel(r"$t U_\infty / W$ since control was requested")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    return figure
