"""The study's figures that `results/model.json` alone decides."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.common.markdown import read
from contract import sensors

DRAG, LIFT, REFERENCE = "#d62728", "#1f77b4", "black"
FORCES: Final = (("drag", "$C_d$", DRAG), ("lift", "$C_l$", LIFT))
BAND: Final = (0.05, 0.45)
"""Frequencies of the training waveform (paper, appendix A), 1/t_c."""


def drawn(results: Path) -> dict[str, Figure]:
    """Every one of them by its file's name."""
    found = read(results)["figures"]
    return {
        "model_importance": importance(found["seeds"][0]),
        "model_sensors": error_by_count(found["counts"]),
        "model_growth": growth(found["seeds"], found["unrolls"]),
        "model_extended": extended(found["disturbed"]["extended"]),
        "model_noise": noise(found["disturbed"]),
        "model_selection": selection(found),
    }


def importance(seed: Mapping[str, Any]) -> Figure:
    """Mean |SHAP| of every sensor at its place, its spread over the repeats, and the chosen ones."""
    ranking = seed["ranking"]
    mean, std = np.array(ranking["mean"]), np.array(ranking["std"])
    chosen = sensors.TRUCK.indices(seed["sensors"])
    places = sensors.positions()
    figure = Figure(figsize=(10.0, 5.4), dpi=100, layout="constrained")
    body, bars = figure.subplots(2, 1, height_ratios=(1, 1.3))
    body.plot([0, 7.647, 7.647, 0, 0], [0.5, 0.5, -0.5, -0.5, 0.5], color="0.7", linewidth=1)
    dots = body.scatter(*places.T, c=mean, s=25 + 250 * mean / mean.max(), cmap="viridis", zorder=3)
    body.scatter(*places[chosen].T, s=330, facecolors="none", edgecolors=DRAG, linewidths=1.6, zorder=4)
    for index in chosen:
        body.annotate(
            sensors.NAMES[index],
            places[index],
            xytext=(0, 16 if places[index, 1] > 0 else -24),
            textcoords="offset points",
            ha="center",
            fontsize=8,
        )
    body.set_aspect("equal")
    body.set(xlabel="x / W", ylabel="y / W", ylim=(-1.1, 1.1))
    figure.colorbar(dots, ax=body, label="mean |SHAP|")
    colours = np.where(np.isin(np.arange(sensors.COUNT), chosen), DRAG, "0.6")
    bars.bar(np.arange(sensors.COUNT), mean, yerr=std, color=colours, ecolor="black", capsize=0)
    for start, name in ((0, "upper"), (40, "lower"), (80, "base")):
        bars.axvline(start - 0.5, color="0.8", linewidth=0.8)
        bars.text(start, bars.get_ylim()[1] * 0.93, f" {name}, front to rear" if start < 80 else " base", fontsize=8)
    bars.set(xlabel="sensor", ylabel="mean |SHAP|", xlim=(-1, 90))
    return figure


def error_by_count(counts: list[Mapping[str, Any]]) -> Figure:
    """Error and R2 on the chirp against the number of sensors (paper, figure 9)."""
    figure = Figure(figsize=(9.0, 3.4), dpi=100, layout="constrained")
    left, right = figure.subplots(1, 2)
    x = [len(item["sensors"]) for item in counts]
    for name, label, colour in FORCES:
        left.plot(x, [item[name]["l1_over_sigma"] for item in counts], "o-", color=colour, label=label, markersize=4)
        right.plot(x, [item[name]["r2"] for item in counts], "o-", color=colour, label=label, markersize=4)
    for axes, label in ((left, r"$L_1/\sigma$"), (right, "$R^2$")):
        axes.set(xscale="log", xlabel="sensors, by their SHAP rank", ylabel=label)
        axes.set_xticks(x, [str(n) for n in x], fontsize=8)
        axes.minorticks_off()
        axes.grid(color="0.9")
        axes.legend(fontsize=8)
    left.set_ylim(bottom=0)
    return figure


def growth(seeds: list[Mapping[str, Any]], unrolls: list[Mapping[str, Any]]) -> Figure:
    """Error of open-loop roll-outs against the step (paper, figure 12)."""
    figure = Figure(figsize=(10.0, 5.4), dpi=100, layout="constrained")
    grid = figure.subplots(2, 2, sharex=True, sharey="row")
    for row, (name, label, _) in enumerate(FORCES):
        for seed in seeds:
            for who, colour in (("teacher", "0.45"), ("slim", DRAG)):
                title = ("90 sensors" if who == "teacher" else "4 sensors by SHAP") if seed["seed"] == 0 else None
                curve = seed["growth"][who]
                grid[row, 0].plot(*_curve(curve, name), color=colour, linewidth=1.2, label=title)
        for item in unrolls:
            grid[row, 1].plot(*_curve(item["rollout"], name), linewidth=1.2, label=f"k = {item['unroll']}")
        for axes in grid[row]:
            axes.axvline(25, color="0.8", linewidth=0.8)
            axes.grid(color="0.92")
            axes.set_ylim(bottom=0)
        grid[row, 0].set_ylabel(rf"{label}: $L_1/\sigma$")
    grid[0, 0].set_title("the release's settings, three seeds", fontsize=10)
    grid[0, 1].set_title("90 sensors, 4 + 4 passes, by unroll k of the last", fontsize=10)
    for axes in (grid[0, 0], grid[0, 1]):
        axes.legend(fontsize=8)
    for axes in grid[1]:
        axes.set_xlabel("control steps ahead (line at 25: the controller's horizon)")
    return figure


def extended(found: Mapping[str, Any]) -> Figure:
    """Sliding error along the extended chirp (paper, figure 14)."""
    figure = Figure(figsize=(9.0, 4.4), dpi=100, layout="constrained")
    grid = figure.subplots(2, 1, sharex=True)
    for column, (_, label, _) in enumerate(FORCES):
        axes: Axes = grid[column]
        axes.axvspan(*BAND, color="#e5f5e0")
        for who, colour, title in (
            ("teacher", "0.4", "90 sensors"),
            ("shap", LIFT, "4 by SHAP"),
            ("hardened", DRAG, "4 by greedy selection under noise"),
        ):
            axes.plot(found["frequency"], np.array(found[who])[:, column], color=colour, linewidth=1.2, label=title)
        axes.set_ylabel(rf"{label}: $L_1/\sigma$")
        axes.set_ylim(bottom=0)
        axes.grid(color="0.92")
    grid[0].legend(fontsize=8, loc="upper center")
    grid[1].set_xlabel("frequency of the forcing, 1 / $t_c$ (green: the training waveform's band)")
    return figure


def noise(found: Mapping[str, Any]) -> Figure:
    """Four sensors under white noise (paper, figure 15)."""
    figure = Figure(figsize=(9.0, 3.4), dpi=100, layout="constrained")
    left, right = figure.subplots(1, 2)
    for who, style, title in (("shap", "o:", "by SHAP"), ("hardened", "o-", "greedy under noise")):
        rows = found[who]["noise"]
        x = [100 * row["level"] for row in rows]
        for name, label, colour in FORCES:
            look = {"color": colour, "label": f"{label}, {title}", "markersize": 4}
            left.plot(x, [row[name]["l1_over_sigma"] for row in rows], style, **look)
            right.plot(x, [row[name]["r2"] for row in rows], style, **look)
    left.set(ylabel=r"$L_1/\sigma$", ylim=(0, None))
    right.set(ylabel="$R^2$", ylim=(-0.5, 1.02))
    for axes in (left, right):
        axes.set_xlabel("noise, % of the global deviation")
        axes.grid(color="0.92")
        axes.legend(fontsize=8)
    return figure


def selection(found: Mapping[str, Any]) -> Figure:
    """How far the choice can be trusted: correlation, leaving one out, and other methods (paper, figure 17)."""
    figure = Figure(figsize=(11.0, 3.8), dpi=100, layout="constrained")
    matrix, left_out, methods = figure.subplots(1, 3, width_ratios=(1, 1, 1.2))
    names = found["seeds"][0]["sensors"]
    values = np.array(found["correlation"])
    matrix.imshow(values, cmap="RdBu_r", vmin=-1, vmax=1)
    matrix.set_xticks(range(len(names)), names, rotation=40, ha="right", fontsize=8)
    matrix.set_yticks(range(len(names)), names, fontsize=8)
    for i, j in np.ndindex(values.shape):
        matrix.text(j, i, f"{values[i, j]:.2f}", ha="center", va="center", fontsize=8, color=_ink(float(values[i, j])))
    matrix.set_title("Pearson correlation", fontsize=10)
    whole = next(item for item in found["counts"] if len(item["sensors"]) == len(names))
    for offset, (name, label, colour) in zip((-0.2, 0.2), FORCES, strict=True):
        heights = [item[name]["l1_over_sigma"] for item in found["without"]]
        left_out.bar(np.arange(len(heights)) + offset, heights, 0.4, color=colour, label=label)
        left_out.axhline(whole[name]["l1_over_sigma"], color=colour, linestyle=":", linewidth=1.2)
    left_out.set_xticks(range(len(names)), [item["removed"] for item in found["without"]], rotation=40, ha="right")
    left_out.tick_params(labelsize=8)
    left_out.set_title(r"$L_1/\sigma$ without it (dotted: with all)", fontsize=10)
    left_out.margins(y=0.2)
    left_out.legend(fontsize=8, loc="upper left", ncols=2)
    order = [item["method"] for item in found["choices"]]
    for offset, (name, _, colour) in zip((-0.12, 0.12), FORCES, strict=True):
        for place, method in enumerate(order):
            errors = [item[name]["l1_over_sigma"] for item in found["methods"] if item["method"] == method]
            methods.plot([place + offset] * len(errors), errors, "o", color=colour, markersize=5)
    methods.set_xticks(range(len(order)), order, fontsize=9)
    methods.set_ylim(bottom=0)
    methods.grid(axis="y", color="0.92")
    methods.set_title(r"$L_1/\sigma$ of four sensors, by method, three seeds", fontsize=10)
    keys = [Line2D([], [], color=colour, marker="o", linestyle="", label=label) for _, label, colour in FORCES]
    methods.legend(handles=keys, fontsize=8, loc="upper right", ncols=2)
    methods.margins(y=0.2)
    return figure


def _ink(value: float) -> str:
    """A colour that can be read on that of a correlation."""
    return "white" if abs(value) > 0.6 else "black"


def _curve(rollout: list[Mapping[str, Any]], name: str) -> tuple[list[int], list[float]]:
    return [item["horizon"] for item in rollout], [item[name] for item in rollout]
