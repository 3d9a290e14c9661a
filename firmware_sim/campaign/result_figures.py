"""Figures of a campaign: drag and side force against noise and delay, and an overview of all scenarios.

Colour-blind readers can distinguish the colours, which are from Okabe and Ito, and the marks. The paper's results under
noise and delay are shown as far as its text states numbers (section 3.3, appendix B).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from firmware_sim.campaign.judgement import ScenarioRow, Spread, Use
from firmware_sim.campaign.scenario import UNDISTURBED

PAPERS_UNCONTROLLED_CD: Final = 1.051
PAPERS_DELAYED_CD: Final = {0: 0.918, 12: 0.950}
"""The paper's mean Cd under control, by the actuator delay in control periods that is compensated (appendix B)."""
PAPERS_NOISE: Final = "consistent drag reduction across all tested noise levels"
"""The paper's statement on noise of 10 to 90 % of the global deviation (appendix B), without numbers."""


BLUE: Final = "#0072B2"
ORANGE: Final = "#E69F00"
VERMILLION: Final = "#D55E00"
COLOURS: Final = {Use.USEFUL: BLUE, Use.MARGINAL: ORANGE, Use.NONE: VERMILLION}
MARKS: Final = {Use.USEFUL: "o", Use.MARGINAL: "D", Use.NONE: "X"}


@dataclass(frozen=True, kw_only=True)
class Curve:
    """The results of scenarios that differ in one number; each point is (this number, row of the scenario)."""

    label: str
    points: tuple[tuple[float, ScenarioRow], ...]


def curve(rows: Sequence[ScenarioRow], label: str, pattern: str) -> Curve:
    """Collect the scenarios whose name matches `pattern`; its group is the number. The undisturbed scenario has 0."""
    found = []
    for row in rows:
        match = re.fullmatch(pattern, row.scenario.name)
        if match is not None:
            found.append((float(match[1]), row))
        elif row.scenario.name == UNDISTURBED:
            found.append((0.0, row))
    return Curve(label=label, points=tuple(sorted(found, key=lambda point: point[0])))


def figures_of(rows: Sequence[ScenarioRow]) -> dict[str, Figure]:
    """Return all figures by file name: the curves that have at least two points, and the overview."""
    noise = curve(rows, "this loop", r"noise_(\d+\.?\d*)")
    delays = curve(rows, "compensated", r"delay_(\d+)"), curve(rows, "not compensated", r"delay_(\d+)_uncompensated")
    # For noise, the paper gives a number only for the undisturbed loop.
    undisturbed = {0: PAPERS_DELAYED_CD[0]}
    found = {
        "noise": curves_figure([noise], "sensor noise / global deviations", "paper", undisturbed),
        "delay": curves_figure(delays, "actuator delay / control periods", "paper, compensated", PAPERS_DELAYED_CD),
        "overview": overview_figure(rows),
    }
    return {name: figure for name, figure in found.items() if figure is not None}


def curves_figure(
    curves: Sequence[Curve], xlabel: str, papers: str, Cd_by_number: Mapping[int, float]
) -> Figure | None:
    """Plot drag reduction and mean |Cl| with the paper's points; return None if no curve has two points."""
    curves = [one for one in curves if len(one.points) > 1]
    if not curves:
        return None
    figure = Figure(figsize=(10.0, 3.6), dpi=100)
    left, right = figure.subplots(1, 2)
    figure.subplots_adjust(left=0.08, right=0.98, bottom=0.15, top=0.97, wspace=0.2)
    left.set_ylabel("less wall drag than without control / %")
    right.set_ylabel("mean $|C_l|$")
    for one, colour, mark in zip(curves, (BLUE, VERMILLION), ("o", "s"), strict=False):
        _draw(left, one.label, [(x, row.reduction) for x, row in one.points], colour, mark)
        _draw(right, one.label, [(x, row.spread("abs_Cl")) for x, row in one.points], colour, mark)
    reductions = [100.0 * (1.0 - Cd / PAPERS_UNCONTROLLED_CD) for Cd in Cd_by_number.values()]
    left.plot(list(Cd_by_number), reductions, "*", color="black", markersize=11, label=papers)
    left.axhline(0.0, color="0.4", linewidth=0.8)
    free = curves[0].points[0][1].spread("abs_Cl", free=True).mean
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
    left.set_yticks(
        range(len(rows)), [f"{'' if row.safe else 'UNSAFE  '}{row.scenario.name}" for row in rows], fontsize=8
    )
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
