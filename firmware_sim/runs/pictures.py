"""A picture that shows a whole run, and the spans of a run in which the ECU's mode is constant."""

import io
from itertools import pairwise
from typing import Any, Final

import matplotlib as mpl
import matplotlib.image
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from firmware_sim.runs.control import mode_names
from firmware_sim.runs.run_log import RunLog
from wake.pictures.drawing import BLOWING, SUCKING

_WIDE: Final = 10.0
"""Width of the figure in inches."""


def overview_figure(log: RunLog, uncontrolled: bytes, controlled: bytes) -> Figure:
    """Plot the wake before and under control, given as PNG, above the time series of drag and action, with a legend."""
    s, t = log.series, log.series["t"]
    figure = Figure(figsize=(_WIDE, 9.7), dpi=100, layout="constrained")
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


def mode_spans(log: RunLog) -> list[tuple[str, int, int]]:
    """Return (mode, first period, period after the last) of every span with a constant mode, in order of time; SKIPPED
    is a mode."""
    names = np.array(mode_names(log))
    edges = [0, *(np.flatnonzero(names[1:] != names[:-1]) + 1).tolist(), len(names)]
    return [(str(names[first]), first, after) for first, after in pairwise(edges) if after > first]


def key() -> list[Any]:
    """Return the legend's handles for the marks in the pictures of the wake."""
    dot: dict[str, Any] = {"marker": "o", "linestyle": "", "markeredgecolor": "black", "markeredgewidth": 0.5}
    return [
        Line2D([], [], **dot, markersize=7, markerfacecolor="#35b779", label="sensor of the controller, by its $C_p$"),
        Line2D([], [], marker=".", linestyle="", color="0.35", markersize=4, label="other wall sensors"),
        Line2D([], [], marker=">", linestyle="", markersize=9, color=BLOWING, label="jet blows"),
        Line2D([], [], marker="<", linestyle="", markersize=9, color=SUCKING, label="jet sucks"),
    ]
