"""The report of a campaign: one self-contained HTML page with a table of the results, curves, and a section for each
group of scenarios. The table and the figures are also written to separate files. The paper's results under noise and
delay are shown as far as its text states numbers (section 3.3, appendix B)."""

import re
from collections.abc import Mapping, Sequence
from datetime import date
from itertools import groupby
from math import isfinite
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from contract.atomic import replacing
from contract.config import loading
from firmware_sim.campaign import judgement
from firmware_sim.campaign.conduct import Campaign, Result
from firmware_sim.campaign.folder import CampaignFolder
from firmware_sim.campaign.judgement import ScenarioRow, Spread, Use, criteria_text
from firmware_sim.campaign.scenario import UNDISTURBED, Criteria
from firmware_sim.runs import pages

PAPERS_UNCONTROLLED_CD: Final = 1.051
PAPERS_DELAYED_CD: Final = {0: 0.918, 12: 0.950}
"""Mean Cd under control in the paper (appendix B), by the compensated delay of the actuator in control periods."""
BLUE: Final = "#0072B2"
VERMILLION: Final = "#D55E00"
COLOURS: Final = {Use.USEFUL: BLUE, Use.MARGINAL: "#E69F00", Use.NONE: VERMILLION}
"""Colours of Okabe and Ito, which colour-blind readers can distinguish."""
MARKS: Final = {Use.USEFUL: "o", Use.MARGINAL: "D", Use.NONE: "X"}
_BARS: Final = "Bars: smallest and largest value of several starts."
_CURVES: Final = {
    "noise": (
        "Sensor noise",
        f"{_BARS} Star: the paper's loop without noise. For noise the paper states 'consistent drag reduction across "
        "all tested noise levels' and shows a picture without numbers.",
    ),
    "delay": (
        "Actuator delay",
        f"{_BARS} Stars: the paper's loop with compensation. Mean Cd is "
        f"{PAPERS_DELAYED_CD[0]:.3f} without delay, {PAPERS_DELAYED_CD[12]:.3f} with 12 periods of delay, and "
        f"{PAPERS_UNCONTROLLED_CD:.3f} without control (appendix B). The paper states no side force in numbers.",
    ),
    "overview": ("Overview", _BARS),
}
_USED: Final = ("operating_point", "flow", "bus", "ecu", "vehicle")  # sections of the settings that the runs use
Points = Sequence[tuple[float, ScenarioRow]]
"""A curve through scenarios that differ in one number; each point is (this number, row of the scenario)."""


def write_report(folder: CampaignFolder, campaign: Campaign, result: Result, day: date) -> None:
    """Write the page, the table and the figures into the folder, each completely or not at all."""
    judgement.write_csv(folder.table, result.rows)
    pictures = {name: pages.png_of(figure) for name, figure in figures_of(result.rows).items()}
    for name, png in pictures.items():
        with replacing(folder.figures / f"{name}.png") as temporary:
            temporary.write_bytes(png)
    manifest, tree = campaign.bundle.manifest, loading.to_tree(campaign.config)
    by_group = groupby(result.rows, lambda row: row.scenario.group)
    pages.write(
        folder.report,
        "campaign.html.j2",
        "firmware_sim.campaign",
        day=day.isoformat(),
        controller=f"{manifest.name} ({manifest.precision}, {campaign.bundle.digest[:12]})",
        phases=campaign.phases,
        seed=campaign.seed,
        timing=campaign.timing,
        reynolds=campaign.config.flow.reynolds,
        safe=result.safe,
        headline=judgement.headline(result.rows),
        heads=judgement.MATRIX_HEADS,
        criteria=criteria_text(Criteria()),
        words_of=criteria_text,
        groups=[(title, [(row, judgement.cells(row)) for row in rows]) for title, rows in by_group],
        curves=[(_CURVES[name][0], pages.data_uri(png), _CURVES[name][1]) for name, png in pictures.items()],
        settings=[f"{name} = {value}" for name, value in loading.leaves({name: tree[name] for name in _USED})],
    )


def curve(rows: Sequence[ScenarioRow], pattern: str) -> Points:
    """Return points (number, row), sorted by number: a point for each scenario whose name matches `pattern`, with the
    number in the pattern's group, and a point for the undisturbed scenario, with the number 0."""
    found = []
    for row in rows:
        match = re.fullmatch(pattern, row.scenario.name)
        if match is not None:
            found.append((float(match[1]), row))
        elif row.scenario.name == UNDISTURBED:
            found.append((0.0, row))
    return sorted(found, key=lambda point: point[0])


def figures_of(rows: Sequence[ScenarioRow]) -> dict[str, Figure]:
    """Return all figures by file name: the curves that have at least two points, and the overview."""
    noise = {"this loop": curve(rows, r"noise_(\d+\.?\d*)")}
    delays = {"compensated": curve(rows, r"delay_(\d+)"), "not compensated": curve(rows, r"delay_(\d+)_uncompensated")}
    # The paper states no Cd under noise, so the paper's only point in this figure is the undisturbed loop.
    undisturbed = {0: PAPERS_DELAYED_CD[0]}
    found = {
        "noise": curves_figure(noise, "sensor noise / global deviations", "paper", undisturbed),
        "delay": curves_figure(delays, "actuator delay / control periods", "paper, compensated", PAPERS_DELAYED_CD),
        "overview": overview_figure(rows),
    }
    return {name: figure for name, figure in found.items() if figure is not None}


def curves_figure(
    curves: Mapping[str, Points], xlabel: str, papers: str, Cd_by_number: Mapping[int, float]
) -> Figure | None:
    """Plot drag reduction and mean |Cl| with the paper's points; return None if no curve has two points."""
    curves = {label: points for label, points in curves.items() if len(points) > 1}
    if not curves:
        return None
    figure = Figure(figsize=(10.0, 3.6), dpi=100)
    left, right = figure.subplots(1, 2)
    figure.subplots_adjust(left=0.08, right=0.98, bottom=0.15, top=0.97, wspace=0.2)
    left.set_ylabel("less wall drag than without control / %")
    right.set_ylabel("mean $|C_l|$")
    for (label, points), colour, mark in zip(curves.items(), (BLUE, VERMILLION), ("o", "s"), strict=False):
        _draw(left, label, [(x, row.reduction) for x, row in points], colour, mark)
        _draw(right, label, [(x, row.spread("abs_Cl")) for x, row in points], colour, mark)
    reductions = [100.0 * (1.0 - Cd / PAPERS_UNCONTROLLED_CD) for Cd in Cd_by_number.values()]
    left.plot(list(Cd_by_number), reductions, "*", color="black", markersize=11, label=papers)
    left.axhline(0.0, color="0.4", linewidth=0.8)
    free = next(iter(curves.values()))[0][1].spread("abs_Cl", free=True).mean
    if isfinite(free):
        right.axhline(free, color="0.4", linewidth=0.8, linestyle=":", label="without control")
    right.set_ylim(bottom=0.0)
    for axes in (left, right):
        axes.set_xlabel(xlabel)
        axes.grid(alpha=0.25)
        axes.legend(frameon=False, fontsize=8)
    return figure


def overview_figure(rows: Sequence[ScenarioRow]) -> Figure:
    """Plot drag reduction and mean |Cl| of every scenario, with the spread over the starting phases."""
    height = 0.9 + 0.24 * len(rows)
    figure = Figure(figsize=(10.0, height), dpi=100)
    left, right = figure.subplots(1, 2, sharey=True, gridspec_kw={"width_ratios": (3, 2), "wspace": 0.06})
    figure.subplots_adjust(left=0.24, right=0.98, bottom=0.55 / height, top=1.0 - 0.35 / height)
    for place, row in enumerate(rows):
        style: dict[str, Any] = {"color": COLOURS[row.use], "marker": MARKS[row.use]}
        for axes, value in ((left, row.reduction), (right, row.spread("abs_Cl"))):
            if isfinite(value.mean):
                axes.plot([value.least, value.most], [place, place], color=style["color"], linewidth=2.0, alpha=0.5)
                axes.plot(value.mean, place, linestyle="", markersize=6, **style)
    names = [f"{'' if row.safe else 'UNSAFE  '}{row.scenario.name}" for row in rows]
    left.set_yticks(range(len(rows)), names, fontsize=8)
    left.set_ylim(len(rows) - 0.4, -0.6)
    left.axvline(0.0, color="0.4", linewidth=0.8)
    left.set_xlabel("less wall drag than without control / %")
    right.set_xlabel("mean $|C_l|$")
    free = rows[0].spread("abs_Cl", free=True).mean if rows else float("nan")
    if isfinite(free):
        right.axvline(free, color="0.4", linewidth=0.8, linestyle=":")
        right.text(free, -0.7, "without control", fontsize=8, ha="right", va="bottom", color="0.3")
    right.set_xlim(left=0.0)
    for axes in (left, right):
        axes.grid(axis="x", alpha=0.25)
    for use in Use:
        left.plot([], [], linestyle="", marker=MARKS[use], color=COLOURS[use], label=str(use))
    left.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False, fontsize=8, borderaxespad=0.1)
    return figure


def _draw(axes: Axes, label: str, points: Sequence[tuple[float, Spread]], colour: str, mark: str) -> None:
    known = [(x, value) for x, value in points if isfinite(value.mean)]
    x = [place for place, _ in known]
    low, mean, high = (np.array([getattr(value, part) for _, value in known]) for part in ("least", "mean", "most"))
    axes.errorbar(
        x, mean, yerr=[mean - low, high - mean] if known else None, color=colour, marker=mark, capsize=3, linewidth=1.2,
        label=label,
    )  # fmt: skip
