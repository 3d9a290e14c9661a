"""A picture of a run's latency: how often which, next to the idle loop."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from contract.arrays import Array
from firmware_sim.latency.measured import Measured
from firmware_sim.latency.stages import Stage

WIDTH: Final = 9.0
"""Inches."""
BINS: Final = 120


def histogram_figure(runs: Sequence[Measured]) -> Figure:
    """Above, from the sampling instant to the command; below, the same scale for a loop that does nothing."""
    figure = Figure(figsize=(WIDTH, 5.6), dpi=110, layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    period_ms = runs[0].periods.period_ns / 1e6
    idle = [run.idle_late / 1e6 for run in runs]
    answers = [_finite(run.periods.values(Stage.ALL)) / 1e6 for run in runs]
    longest = max(float(values.max(initial=period_ms)) for values in (*answers, *idle))
    bins = np.linspace(0.0, 1.02 * longest, BINS + 1).tolist()
    for axes, values_of, labels in (
        (above, answers, [f"{run.name}: {run.about}" for run in runs]),
        (below, idle, [f"next to {run.name}" for run in runs]),
    ):
        for values, label, colour in zip(values_of, labels, ("#1f78b4", "#d95f02"), strict=False):
            axes.hist(values, bins=bins, histtype="stepfilled", alpha=0.6, color=colour, label=label)
    above.axvline(period_ms, color="tab:red", linestyle="--", linewidth=1.2, label="boundary that a command is due at")
    above.set_ylabel("periods")
    above.set_title("from the sampling instant to the command", fontsize=10, loc="left")
    below.set_title("idle loop: from its deadline to waking up", fontsize=10, loc="left")
    below.set_ylabel("periods")
    below.set_xlabel("ms")
    for axes in (above, below):
        axes.set_yscale("log")
        axes.set_ylim(0.7, None)  # a single period is to be seen
        axes.set_xlim(0.0, bins[-1])
        axes.grid(alpha=0.25)
        axes.legend(fontsize=8, loc="upper right")
    return figure


def _finite(values: Array) -> Array:
    return values[np.isfinite(values)]
