"""Several runs' drag, lift and action over the time since control was requested, for where no script runs."""

from collections.abc import Sequence
from typing import Final

from matplotlib.figure import Figure

from firmware_sim.runs.pictures import WIDE
from firmware_sim.runs.run_log import RunLog

_DRAWN: Final = (("Cd", "$C_d$ (wall)"), ("Cl", "$C_l$"), ("action", r"action / $U_\infty W$"))


def comparison_figure(logs: Sequence[RunLog], names: Sequence[str]) -> Figure:
    """A curve for each run; a run in which control was never requested begins at 0."""
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
