"""The report of a run as one HTML page (verdict, tables, series, recorded wake, settings) and as a picture, and a page
that compares runs (figures, differences, settings, pictures of the wakes)."""

import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import matplotlib as mpl
import matplotlib.image
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from contract.atomic import replacing
from contract.errors import StillwakeError
from firmware_sim.runs import pages, run_log, wake_stills
from firmware_sim.runs.control import trouble
from firmware_sim.runs.metadata import settings_of
from firmware_sim.runs.run_log import RunFolder, RunLog
from firmware_sim.runs.run_page.run_data import run_data
from firmware_sim.runs.statistics import NoAverages, averages
from firmware_sim.runs.summary import drag_rows, headline, service_rows, summary
from firmware_sim.runs.wake_stills import WakeStills
from wake.pictures.drawing import BLOWING, SUCKING, check_suffix

_MOST_FRAMES: Final = 50_000  # longest log whose messages a page shows; reading such a log takes ten seconds
_BUS_HEADS: Final = ("identifier", "message", "frames", "per s", "lost", "end-to-end checks")
_MOST: Final = 6  # largest number of runs on a page; with more runs the curves could not be distinguished
NONE: Final = "\N{EN DASH}"
_SAME: Final = "="  # text in place of a difference that is zero when written in the figure's number format
_FIGURES: Final = (
    ("mean Cd (wall), uncontrolled", "Cd_uncontrolled", ".4f"),
    ("mean Cd (wall), controlled", "Cd_controlled", ".4f"),
    ("less wall drag / %", "reduction_percent", ".2f"),
    ("mean Cd, wall + slots + jet momentum, controlled", "Cd_net_controlled", ".4f"),
    ("mean base Cp, controlled", "base_Cp_controlled", ".4f"),
    ("mean |Cl|, controlled", "abs_Cl_controlled", ".4f"),
    ("mean Cl, controlled", "mean_Cl_controlled", ".4f"),
    ("rms action / U_inf W", "rms_action", ".4f"),
    ("mean jet power / (rho U_inf^3 W / 2)", "jet_power_controlled", ".4f"),
    ("periods with a request", "periods_requested", "d"),
    ("periods in control", "periods_in_control", "d"),
    ("control step p50 / ms", "mpc_ms_p50", ".2f"),
    ("control step p99 / ms", "mpc_ms_p99", ".2f"),
    ("sample to jets, max / ms", "sample_to_jets_ms_max", ".2f"),
    ("frames lost", "frames_lost", "d"),
    ("frames rejected", "frames_rejected", "d"),
)
"""Label, name in `firmware_sim.runs.summary.summary`, and number format of each figure."""


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
    run = read_run(folder)
    log, metadata = run.log, run.log.metadata
    wake = wake_of(folder, log)
    settings = [f"{name} = {value}" for name, value in settings_of(metadata).items()]
    return pages.write(
        folder.report if target is None else target,
        "report.html.j2",
        title=f"stillwake run of {metadata.origin.day}",
        inlined=pages.inlined("report.js"),
        run=metadata,
        trouble=trouble(log),
        headline=headline(log),
        drag_rows=drag_rows(log),
        averaged=not isinstance(averages(log), NoAverages),
        service_rows=service_rows(log),
        bus_heads=_BUS_HEADS,
        bus_rows=_bus_rows(folder, log),
        uncontrolled_picture=pages.data_uri(run.uncontrolled),
        controlled_picture=pages.data_uri(run.controlled),
        settings=[*settings, *(f"{name} {value}" for name, value in metadata.versions.items())],
        replay=pages.as_json(run_data(log, wake, "")),
    )


def wake_of(folder: RunFolder, log: RunLog) -> WakeStills | None:
    """Read the recorded wake; None for a folder of an earlier version. Raises StillwakeError if the file is damaged."""
    return wake_stills.load(folder.wake, log) if folder.wake.exists() else None


def _bus_rows(folder: RunFolder, log: RunLog) -> list[tuple[str, ...]]:
    """Return a row per identifier of the log; no row for a missing or long log. A damaged log raises StillwakeError."""
    if log.traffic.frames > _MOST_FRAMES or not folder.frames.is_file():
        return []
    # These imports take a second, because they import all readers of python-can. So they are inside the function.
    from can_bridge.bus.conversion import id_text
    from can_bridge.logs.log_reader import CanLog
    from can_bridge.tools.traffic import Summary

    found, rows = Summary(config=log.metadata.config.bus), list[tuple[str, ...]]()
    for message in CanLog(folder.frames):
        found.add(message)
    for _, one in sorted(found.messages.items()):
        checks = ", ".join(f"{text} {count}" for text, count in one.verdicts.items())
        ending = (str(one.lost), checks) if one.is_protected else ("", "")
        name = one.name or "of another node"
        rows.append((id_text(one.latest), name, str(one.count), f"{one.mean_rate_hz:.1f}", *ending))
    return rows


def write_picture(folder: RunFolder, target: Path) -> None:
    """Write one picture of the run: the wake before and under control, and drag and action over time. Raises
    ConfigError for a suffix that is no picture format; StillwakeError without a run, or if writing fails."""
    check_suffix(target)
    run = read_run(folder)
    kind = target.suffix[1:].lower()
    # PDF has no metadata field named Description, so the digest is in the field Subject.
    described = {"Subject" if kind == "pdf" else "Description": f"stillwake bundle {run.log.metadata.digest}"}
    with replacing(target) as temporary:
        _overview_figure(run).savefig(temporary, format=kind, metadata=described)


def _overview_figure(run: ReadRun) -> Figure:
    s, t = run.log.series, run.log.series["t"]
    figure = Figure(figsize=(10.0, 9.7), dpi=100, layout="constrained")
    axes = figure.subplots(4, 1, height_ratios=(3.1, 3.1, 1.6, 1.6))
    for axis, picture in zip(axes, (run.uncontrolled, run.controlled), strict=False):
        axis.imshow(mpl.image.imread(io.BytesIO(picture), format="png"))
        axis.set_axis_off()
    for axis, name, label in zip(axes[2:], ("Cd", "action"), ("$C_d$ (wall)", r"action / $U_\infty W$"), strict=True):
        axis.plot(t, s[name], color="black" if name == "Cd" else "tab:orange", linewidth=1.1)
        if run.log.enabled_at < len(t):
            axis.axvline(t[run.log.enabled_at], color="0.4", linewidth=1.0, linestyle=":")
        axis.set_ylabel(label)
        axis.grid(alpha=0.25)
    axes[-1].set_xlabel(r"$t U_\infty / W$   (dotted: control requested)")
    dot: dict[str, Any] = {"marker": "o", "linestyle": "", "markeredgecolor": "black", "markeredgewidth": 0.5}
    marks = [
        Line2D([], [], **dot, markersize=7, markerfacecolor="#35b779", label="sensor of the controller, by its $C_p$"),
        Line2D([], [], marker=".", linestyle="", color="0.35", markersize=4, label="other wall sensors"),
        Line2D([], [], marker=">", linestyle="", markersize=9, color=BLOWING, label="jet blows"),
        Line2D([], [], marker="<", linestyle="", markersize=9, color=SUCKING, label="jet sucks"),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


class Cell(NamedTuple):
    """A figure of one run and its difference from the first run's figure, as texts; the difference may be empty."""

    value: str
    difference: str


def names_of(folders: Sequence[Path]) -> list[str]:
    """Return unique names of the runs. Raises StillwakeError for a wrong number of runs, or a run given twice."""
    places = [Path(os.path.realpath(folder)) for folder in folders]
    if not 2 <= len(places) <= _MOST:
        raise StillwakeError(f"{len(places)} runs cannot be compared on a page; give between 2 and {_MOST} runs")
    for place, folder in zip(places, folders, strict=True):
        if places.count(place) > 1:
            raise StillwakeError(f"{folder} is given twice; give different runs")
    depth, names = 1, [place.name for place in places]
    while len(set(names)) < len(names):
        depth += 1
        names = ["/".join(place.parts[-depth:]) for place in places]
    return names


def figure_rows(logs: Sequence[RunLog]) -> list[tuple[str, list[Cell]]]:
    """Return (quantity, one cell per run) for each figure."""
    summaries = [summary(log) for log in logs]
    return [(label, _cells([one[name] for one in summaries], style)) for label, name, style in _FIGURES]


def differing(logs: Sequence[RunLog]) -> list[tuple[str, list[str]]]:
    """Return (property, one text per run) for every property that differs between the runs."""
    made = [_made_with(log) for log in logs]
    names = list(dict.fromkeys(name for one in made for name in one))
    rows = [(name, [one.get(name, NONE) for one in made]) for name in names]
    return [(name, texts) for name, texts in rows if len(set(texts)) > 1]


def _cells(values: Sequence[Any], style: str) -> list[Cell]:
    first = values[0]
    cells = [Cell(NONE if value is None else f"{value:{style}}", "") for value in values]
    for place, value in enumerate(values[1:], start=1):
        if value is not None and first is not None:
            same = f"{abs(value - first):{style}}" == f"{0:{style}}"
            cells[place] = Cell(cells[place].value, _SAME if same else f"{value - first:+{style}}")
    return cells


def _made_with(log: RunLog) -> Mapping[str, str]:
    run, periods, control_period = log.metadata, len(log.series["t"]), log.metadata.config.flow.control_period
    return {
        "bundle": run.controller,
        "signed by": "no one" if run.signer is None else run.signer[:12],
        "plant": run.plant,
        "began from": run.origin.flow,
        "time without control / t_c": f"{log.enabled_at * control_period:g}",
        "time with control / t_c": f"{(periods - log.enabled_at) * control_period:g}",
        "left out of the averages / t_c": f"{run.settle:g}" if run.averages else "no averages",
        "drive": run.drive or "none",
        "sensors": ", ".join(run.sensors),
        "disturbances": "; ".join(fault.text for fault in run.faults) or "none",
        "seed of the disturbances": str(run.fault_seed),
        "ECU": run.ecu.kind if run.ecu.clock_mhz is None else f"{run.ecu.kind}, {run.ecu.clock_mhz:g} MHz",
        "control step computed by": run.computed_by,
        **settings_of(run),
        **{f"version: {name}": text for name, text in run.versions.items()},
    }


def write_comparison(folders: Sequence[RunFolder], target: Path) -> Path:
    """Write the page that compares the runs; return its path. Raises StillwakeError if this is not possible."""
    names = names_of([folder.path for folder in folders])
    runs = [read_run(folder) for folder in folders]
    logs = [run.log for run in runs]
    wakes = [wake_of(folder, run.log) for folder, run in zip(folders, runs, strict=True)]
    return pages.write(
        target,
        "compare.html.j2",
        title=f"stillwake: {', '.join(names)}",
        inlined=pages.inlined("compare.js"),
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
        replays=pages.as_json([run_data(log, wake, name) for log, wake, name in zip(logs, wakes, names, strict=True)]),
    )
