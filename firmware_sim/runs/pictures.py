"""Pictures of a run: its time series with the ECU's modes, its latency, and the wake."""

import io
from itertools import pairwise
from typing import Any, Final

import matplotlib as mpl
import matplotlib.image
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from can_bridge.wire.messages import Mode
from firmware_sim.runs.control import SKIPPED
from firmware_sim.runs.run_log import WITHOUT, RunLog
from firmware_sim.runs.statistics import planned_steps
from wake.pictures.drawing import BLOWING, SUCKING

WIDE: Final = 10.0
"""Inches of a picture on a page."""
NARROW: Final = 4.4
"""Inches of the same on a phone: type has the same size, so that it can be read there."""
_SERIES_HEIGHT: Final = 11.0

_MODES: Final = {
    Mode.OFF.name: "0.88",
    Mode.WARMUP.name: "#9ecae1",
    Mode.CONTROL.name: "#4daf4a",
    Mode.HOLD.name: "#ffd92f",
    Mode.DECAY.name: "#ff7f00",
    Mode.FAULT.name: "#e41a1c",
    SKIPPED: "black",
}
"""Colours of the strip of modes."""


def overview_figure(log: RunLog, uncontrolled: bytes, controlled: bytes) -> Figure:
    """The wake before and under control, given as PNG, over the time series of drag and action, with a key."""
    s, t = log.series, log.series["t"]
    figure = Figure(figsize=(WIDE, 9.7), dpi=100, layout="constrained")
    axes = figure.subplots(4, 1, height_ratios=(3.1, 3.1, 1.6, 1.6))
    for axis, picture in zip(axes, (uncontrolled, controlled), strict=False):
        axis.imshow(mpl.image.imread(io.BytesIO(picture), format="png"))
        axis.set_axis_off()
    for axis, name, label in zip(axes[2:], ("Cd", "action"), ("$C_d$ (wall)", r"action / $U_\infty W$"), strict=True):
        axis.plot(t, s[name], color="black" if name == "Cd" else "tab:orange", linewidth=1.1)
        axis.axvline(t[log.enabled_at], color="0.4", linewidth=1.0, linestyle=":")
        axis.set_ylabel(label)
        axis.grid(alpha=0.25)
    axes[-1].set_xlabel(r"$t U_\infty / W$   (dotted: control requested)")
    figure.legend(handles=key(), loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def series_figure(log: RunLog, width: float = WIDE) -> Figure:
    """The ECU's mode, drag, lift, base pressure, action, step time and on a drive the speed over time."""
    s, t = log.series, log.series["t"]
    budget_ms, settle, on_drive = log.metadata.budget_ms, log.metadata.settle, log.metadata.drive is not None
    # Margins are given: matplotlib's own layout may differ in the last pixel from one drawing to the next.
    figure = Figure(figsize=(width, _SERIES_HEIGHT), dpi=110)
    strip, *axes = figure.subplots(
        6 + on_drive, 1, sharex=True, height_ratios=(0.35, *(2,) * (5 + on_drive)),
        gridspec_kw={
            "left": 1.0 / width, "right": 1.0 - 0.2 / width, "hspace": 0.17,
            "bottom": 0.6 / _SERIES_HEIGHT, "top": 1.0 - (0.4 if width > 0.5 * WIDE else 0.8) / _SERIES_HEIGHT,
        },
    )  # fmt: skip
    _draw_modes(strip, log, columns=7 if width > 0.5 * WIDE else 3)
    axes[0].plot(t, s["Cd"], color="black", linewidth=1.1, label="flow")
    # A forecast made at t_k is for t_{k+1}.
    axes[0].plot(t[1:], s["predicted_Cd"][:-1], color="tab:blue", linewidth=0.9, alpha=0.8, label="one step ahead")
    axes[1].plot(t, s["Cl"], color="black", linewidth=1.1)
    axes[1].plot(t[1:], s["predicted_Cl"][:-1], color="tab:blue", linewidth=0.9, alpha=0.8)
    axes[2].plot(t, s["base_Cp"], color="tab:green", linewidth=1.1)
    axes[3].plot(t, s["action"], color="tab:orange", linewidth=1.1)
    planned = planned_steps(log)
    slowest = np.max(s["step_ms"][planned], initial=budget_ms)
    axes[4].plot(t[planned], s["step_ms"][planned], ".", color="tab:purple", markersize=2.5)
    axes[4].axhline(budget_ms, color="tab:red", linewidth=1.0, linestyle="--")
    axes[4].text(t[0], budget_ms, " budget", color="tab:red", va="top", fontsize=9)
    axes[4].set_ylim(0.0, 1.1 * slowest)
    labels = ["$C_d$ (wall)", "$C_l$", "base $C_p$", r"action / $U_\infty W$", "control step / ms"]
    if on_drive:
        axes[0].plot(t, s[WITHOUT[0]], color="0.6", linewidth=0.9, label="jets shut", zorder=1)
        axes[5].plot(t, s["speed"], color="tab:green", linewidth=1.1)
        labels.append("speed / (m/s)")
    for axis, label in zip(axes, labels, strict=True):
        axis.set_ylabel(label)
        axis.grid(alpha=0.25)
        if log.enabled_at < len(t):
            axis.axvline(t[log.enabled_at], color="0.4", linewidth=1.0, linestyle=":")
            if log.metadata.averages:
                axis.axvspan(t[log.enabled_at], t[log.enabled_at] + settle, color="0.93", zorder=0)
    # Above the axes: over a short run the key would lie on the curves.
    axes[0].legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2 + on_drive, frameon=False, fontsize=9, borderaxespad=0.1
    )
    axes[-1].set_xlabel(r"$t U_\infty / W$")
    figure.align_ylabels(axes)
    return figure


def latency_figure(log: RunLog) -> Figure:
    """How often a control step took how long on this machine, and the budget."""
    figure = Figure(figsize=(NARROW, 2.6), dpi=110)
    figure.subplots_adjust(left=0.14, right=0.96, bottom=0.2, top=0.89)
    axes = figure.add_subplot(xlabel="control step on this machine / ms", ylabel="steps")
    planned = log.series["step_ms"][planned_steps(log)]
    budget_ms = log.metadata.budget_ms
    if len(planned):
        axes.hist(planned, bins=np.linspace(0.0, max(budget_ms, float(planned.max())), 61).tolist(), color="tab:purple")
        for percentile in (50, 99):
            axes.axvline(float(np.percentile(planned, percentile)), color="0.2", linewidth=0.8, linestyle=":")
    else:
        axes.text(0.5, 0.5, "no control step ran", transform=axes.transAxes, ha="center")
    axes.axvline(budget_ms, color="tab:red", linewidth=1.2, linestyle="--")
    axes.set_title("dotted: p50 and p99; red: budget", fontsize=9)
    axes.set_xlim(0.0, None)
    return figure


def mode_spans(log: RunLog) -> list[tuple[str, int, int]]:
    """(mode, first period, period after the last) of every stretch of one mode, in order; SKIPPED is one of them."""
    skipped = np.isnan(log.series["step_ms"])
    names = np.array(
        [
            SKIPPED if left_out else Mode(int(mode)).name
            for mode, left_out in zip(log.series["mode"], skipped, strict=True)
        ]
    )
    edges = [0, *(np.flatnonzero(names[1:] != names[:-1]) + 1).tolist(), len(names)]
    return [(str(names[first]), first, after) for first, after in pairwise(edges) if after > first]


def _draw_modes(axes: Axes, log: RunLog, columns: int) -> None:
    t = log.series["t"]
    step = float(t[1] - t[0]) if len(t) > 1 else 1.0
    spans = mode_spans(log)
    for name, first, after in spans:
        axes.axvspan(t[0] + first * step, t[0] + after * step, color=_MODES[name], linewidth=0)
    axes.set_yticks([])
    axes.set_ylabel("mode", rotation=0, ha="right", va="center")
    seen = [name for name in _MODES if any(name == one for one, _, _ in spans)]
    axes.legend(
        handles=[Patch(color=_MODES[name], label=name) for name in seen],
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, frameon=False, fontsize=9,
        borderaxespad=0.1, handlelength=1.0, columnspacing=1.0,
    )  # fmt: skip


def key() -> list[Any]:
    """Handles of a legend: what the marks in the pictures of the wake stand for."""
    dot: dict[str, Any] = {"marker": "o", "linestyle": "", "markeredgecolor": "black", "markeredgewidth": 0.5}
    return [
        Line2D([], [], **dot, markersize=7, markerfacecolor="#35b779", label="sensor of the controller, by its $C_p$"),
        Line2D([], [], marker=".", linestyle="", color="0.35", markersize=4, label="other wall sensors"),
        Line2D([], [], marker=">", linestyle="", markersize=9, color=BLOWING, label="jet blows"),
        Line2D([], [], marker="<", linestyle="", markersize=9, color=SUCKING, label="jet sucks"),
    ]
