"""The pictures of a release in the loop: errors of its forecasts, distributions, Cp along the body, and mean flows."""

import statistics
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.common.command_line import ROOT
from benchmarks.common.documents import draw, read
from contract import sensors
from wake.pictures.drawing import draw_mean
from wake.solver.grid import Flow
from wake.truck.develop import recirculation_length
from wake.truck.truck_wake import TruckWake

UNCONTROLLED, CONTROLLED = "0.25", "#1f77b4"
_CASES: Final = (("uncontrolled", UNCONTROLLED), ("controlled", CONTROLLED))
_BEHIND: Final = (-0.6, 10.4, -1.5, 1.5)
"""Limits of the shown area in W: smallest and largest x, measured from the base, then smallest and largest y."""


def drawn(figures: Mapping[str, Any]) -> dict[str, Figure]:
    """Draw the pictures that need only the figures in the results file, by file name."""
    return {"release_forecasts": forecasts(figures), "release_distributions": distributions(figures)}


def forecasts(figures: Mapping[str, Any]) -> Figure:
    """Plot the mean error of the forecasts over the horizon, and the range between its 10 % and 90 % quantiles."""
    figure = Figure(figsize=(9.0, 3.2), dpi=100, layout="constrained")
    rows = figures["forecast"]
    ahead = [row["h"] for row in rows]
    panels = figure.subplots(1, 2)
    for axes, name, label, colour in zip(panels, ("drag", "lift"), ("C_d", "C_l"), ("#d62728", "#1f77b4"), strict=True):
        low, mean, high = ([row[name][key] for row in rows] for key in ("p10", "mean", "p90"))
        axes.fill_between(ahead, low, high, color=colour, alpha=0.2, linewidth=0.0, label="10 to 90 %")
        axes.plot(ahead, mean, "o-", color=colour, markersize=3, linewidth=1.2, label="mean")
        sigma = figures["sigma"]["uncontrolled"][name]
        axes.set(xlabel="control steps ahead", ylabel=f"|error of ${label}$|", xlim=(0.5, ahead[-1] + 0.5))
        axes.set_ylim(0.0, 1.15 * max(high))
        axes.set_title(f"${label}$; without control its deviation is {sigma:.3f}", fontsize=9)
        axes.grid(color="0.92")
        axes.legend(fontsize=8, loc="lower right")
    return figure


def distributions(figures: Mapping[str, Any]) -> Figure:
    """Plot the distributions of base pressure and of transverse velocity at the probe, and mean Cp along the body."""
    figure = Figure(figsize=(10.0, 3.2), dpi=100, layout="constrained")
    base, probe, along = figure.subplots(1, 3)
    _histogram(base, figures["base_Cp"], "base $C_p$, mean over 10 sensors")
    _histogram(probe, figures["Uy"], r"$U_y / U_\infty$ at the probe (10, 0)")
    x = sensors.TRUCK.positions[: sensors.PER_SIDE, 0]
    for (case, colour), one in zip(_CASES, figures["mean"], strict=True):
        values, n = np.array(one["Cp"]), sensors.PER_SIDE
        # Over a long time the mean flow would be symmetric, so the upper and the lower side are averaged here.
        along.plot(x, 0.5 * (values[:n] + values[n : 2 * n]), color=colour, linewidth=1.4, label=case)
        across = values[sensors.BASE]
        along.plot(np.full(len(across), x[-1] + 0.25), across, ".", color=colour, markersize=4)
    along.set(xlabel="x / W along the sides; dots: base", ylabel="mean $C_p$")
    along.legend(fontsize=8)
    along.grid(color="0.92")
    return figure


def weights(figures: Mapping[str, Any]) -> dict[str, Figure]:
    """Plot the drag, and the figures that a weight is meant to reduce, against the weight."""
    figure = Figure(figsize=(8.0, 3.0), layout="constrained")
    shown = (("lift", "abs_Cl_controlled", "mean |Cl|"), ("effort", "jet_power_controlled", "jet power"))
    for axes, (weight, name, label) in zip(figure.subplots(1, 2), shown, strict=True):
        runs = [row for row in figures["runs"] if row["weight"] == weight]
        average = means(figures["runs"], weight)
        axes.plot([run["value"] for run in runs], [run[name] for run in runs], ".", color="tab:blue", alpha=0.5)
        axes.plot(list(average), [found[name] for found in average.values()], "-", color="tab:blue")
        axes.set(xlabel=f"weight on {weight}", ylabel=label)
        axes.set_ylim(bottom=0.0)
        drag = axes.twinx()
        drag.plot(list(average), [found["reduction_percent"] for found in average.values()], "s--", color="tab:orange")
        drag.set(ylabel="less drag, %", ylim=(0.0, 40.0))
        drag.yaxis.label.set_color("tab:orange")
        axes.yaxis.label.set_color("tab:blue")
    return {"weights": figure}


def means(rows: Sequence[Mapping[str, Any]], weight: str) -> dict[float, dict[str, float]]:
    """Return every figure's mean over the starts, by the value of the weight."""
    found: dict[float, dict[str, float]] = {}
    for value in dict.fromkeys(row["value"] for row in rows if row["weight"] == weight):
        runs = [row for row in rows if (row["weight"], row["value"]) == (weight, value)]
        names = (name for name, figure in runs[0].items() if isinstance(figure, float) and name != "value")
        found[value] = {name: statistics.mean(run[name] for run in runs) for name in names}
    return found


def _histogram(axes: Axes, found: Mapping[str, Any], label: str) -> None:
    for case, colour in _CASES:
        one = found[case]
        axes.stairs(one["density"], found["edges"], color=colour, fill=True, alpha=0.35)
        axes.stairs(one["density"], found["edges"], color=colour, linewidth=1.0)
        axes.axvline(one["mean"], color=colour, linewidth=1.0, linestyle=":")
        axes.plot([], [], color=colour, linewidth=4, alpha=0.6, label=f"{case}: {one['mean']:.3f} ± {one['std']:.3f}")
    axes.set(xlabel=label, ylabel="probability density")
    # The larger range leaves space above the tallest bar for the legend.
    axes.set_ylim(top=1.3 * axes.get_ylim()[1])
    axes.legend(fontsize=8, loc="upper center")


def mean_flows(wake: TruckWake, flows: Sequence[Flow]) -> Figure:
    """Plot the mean velocity u behind the truck without and with control, with the bubble and its length."""
    left, right, low, high = _BEHIND
    view = (wake.body.length + left, wake.body.length + right, low, high)
    figure = Figure(figsize=(9.0, 5.4), dpi=100, layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for axes, (case, _), flow in zip(panels, _CASES, flows, strict=True):
        image = draw_mean(axes, wake.grid, wake.body, flow, view, density=(2.2, 0.8))
        axes.set(xlim=view[:2], ylim=view[2:], ylabel="y / W")
        axes.set_title(f"{case}: bubble {recirculation_length(wake.grid, flow):.2f} W", fontsize=10, loc="left")
    panels[-1].set_xlabel("x / W")
    figure.colorbar(image, ax=list(panels), label=r"mean $u / U_\infty$", fraction=0.025, pad=0.012, extend="both")
    return figure


def main() -> None:
    """Draw every picture in `docs/pictures` that depends only on `results/*.json`; `make tables` does this too."""
    for name, made in (("release_figures", drawn), ("weights", weights)):
        source = ROOT / "results" / f"{name}.json"
        draw(made(read(source)["figures"]), source)
