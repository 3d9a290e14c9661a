"""Pictures of a run: its time series, and the wake beside them."""

import io

import matplotlib as mpl
import matplotlib.image
import numpy as np
from matplotlib.figure import Figure

from can_bridge.wire.messages import Mode
from firmware_sim.runs.run_log import RunLog


def overview_figure(log: RunLog, uncontrolled: bytes, controlled: bytes) -> Figure:
    """The wake before and under control, given as PNG, over the time series of drag and action."""
    s, t = log.series, log.series["t"]
    figure = Figure(figsize=(10.0, 9.4), dpi=100, layout="constrained")
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
    return figure


def series_figure(log: RunLog) -> Figure:
    """Drag, lift, base pressure, action and latency over time."""
    s, t = log.series, log.series["t"]
    budget_ms, settle = log.metadata.budget_ms, log.metadata.settle
    figure = Figure(figsize=(10.0, 10.5), dpi=110, layout="constrained")
    axes = figure.subplots(5, 1, sharex=True)
    axes[0].plot(t, s["Cd"], color="black", linewidth=1.1, label="flow")
    # A forecast made at t_k is for t_{k+1}.
    axes[0].plot(t[1:], s["predicted_Cd"][:-1], color="tab:blue", linewidth=0.9, alpha=0.8, label="one step ahead")
    axes[1].plot(t, s["Cl"], color="black", linewidth=1.1)
    axes[1].plot(t[1:], s["predicted_Cl"][:-1], color="tab:blue", linewidth=0.9, alpha=0.8)
    axes[2].plot(t, s["base_Cp"], color="tab:green", linewidth=1.1)
    axes[3].plot(t, s["action"], color="tab:orange", linewidth=1.1)
    planned = s["mode"] == Mode.CONTROL
    slowest = np.nanmax(s["step_ms"][planned], initial=budget_ms)
    axes[4].plot(t[planned], s["step_ms"][planned], ".", color="tab:purple", markersize=2.5)
    axes[4].axhline(budget_ms, color="tab:red", linewidth=1.0, linestyle="--")
    axes[4].text(t[0], budget_ms, " budget", color="tab:red", va="top", fontsize=9)
    axes[4].set_ylim(0.0, 1.1 * slowest)
    labels = ("$C_d$ (wall)", "$C_l$", "base $C_p$", r"action / $U_\infty W$", "control step / ms")
    for axis, label in zip(axes, labels, strict=True):
        axis.set_ylabel(label)
        axis.grid(alpha=0.25)
        if log.enabled_at < len(t):
            axis.axvline(t[log.enabled_at], color="0.4", linewidth=1.0, linestyle=":")
            axis.axvspan(t[log.enabled_at], t[log.enabled_at] + settle, color="0.93", zorder=0)
    axes[0].legend(loc="upper right", ncols=2, frameon=False)
    axes[-1].set_xlabel(r"$t U_\infty / W$   (grey: settling, left out of the averages)")
    figure.align_ylabels()
    return figure
