"""The comparison of runs as one self-contained HTML page: figures, differences, settings, pictures of the wakes."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from contract.errors import StillwakeError
from firmware_sim.runs import pages
from firmware_sim.runs.control import trouble
from firmware_sim.runs.metadata import settings_of
from firmware_sim.runs.run_folder import RunFolder
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.run_page.inlined import as_json, inlined
from firmware_sim.runs.run_page.report import read_run, wake_of
from firmware_sim.runs.run_page.run_data import run_data
from firmware_sim.runs.run_tables import headline
from firmware_sim.runs.summary import summary

_MOST: Final = 6
"""Largest number of runs on a page; with more runs the curves could not be distinguished."""
NONE: Final = "\N{EN DASH}"
_SAME: Final = "="
"""Sign for a difference that is zero in the figure's number format."""

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
    ("periods requested", "periods_requested", "d"),
    ("periods in control", "periods_in_control", "d"),
    ("control step p50 / ms", "mpc_ms_p50", ".2f"),
    ("control step p99 / ms", "mpc_ms_p99", ".2f"),
    ("sample to jets, max / ms", "sample_to_jets_ms_max", ".2f"),
    ("frames lost", "frames_lost", "d"),
    ("frames rejected", "frames_rejected", "d"),
)
"""Label, name in `firmware_sim.runs.summary.summary`, and number format of each figure."""


class Cell(NamedTuple):
    """A figure of one run and its difference from the first run's figure, as texts; the difference may be empty."""

    value: str
    difference: str


def names_of(folders: Sequence[Path]) -> list[str]:
    """Return unique names, with parents if needed. Raises StillwakeError for too few, too many or equal folders."""
    places = [Path(os.path.realpath(folder)) for folder in folders]
    if not 2 <= len(places) <= _MOST:
        raise StillwakeError(f"{len(places)} runs: between 2 and {_MOST} can be compared on a page")
    for place, folder in zip(places, folders, strict=True):
        if places.count(place) > 1:
            raise StillwakeError(f"{folder}: given twice; name different runs")
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
    """Return (property, one text per run) for every property that differs."""
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
    run, periods = log.metadata, len(log.series["t"])
    control_period = run.config.flow.control_period
    return {
        "bundle": run.controller,
        "signed by": "no one" if run.signer is None else run.signer[:12],
        "plant": run.plant,
        "began from": run.origin.flow,
        "time without control / t_c": f"{log.enabled_at * control_period:g}",
        "time with control / t_c": f"{(periods - log.enabled_at) * control_period:g}",
        "left out of the averages / t_c": f"{run.settle:g}" if run.averages else "no averages",
        "sensors": ", ".join(run.sensors),
        "disturbances": "; ".join(fault.text for fault in run.faults) or "none",
        "seed of the disturbances": str(run.fault_seed),
        "ECU": run.ecu.kind if run.ecu.clock_mhz is None else f"{run.ecu.kind}, {run.ecu.clock_mhz:g} MHz",
        "control step computed by": run.computed_by,
        **settings_of(run),
        **{f"version: {name}": text for name, text in run.versions.items()},
    }


def write_comparison(folders: Sequence[RunFolder], target: Path) -> Path:
    """Write the page; return its path. Raises StillwakeError if runs or files cannot be compared, read or written."""
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
