"""A picture of a run's latency: how often which, next to the idle loop."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

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
    everything = [run.periods.values(Stage.ALL) for run in runs]
    answers, idle = [values[np.isfinite(values)] / 1e6 for values in everything], [run.idle_late / 1e6 for run in runs]
    longest = max(float(values.max(initial=period_ms)) for values in (*answers, *idle))
    bins = np.linspace(0.0, 1.02 * longest, BINS + 1).tolist()
    above.axvline(period_ms, color="tab:red", linestyle="--", linewidth=1.2, label="boundary that a command is due at")
    for axes, title, values_of, labels in (
        (above, "from the sampling instant to the command", answers, [f"{run.name}: {run.about}" for run in runs]),
        (below, "idle loop: from its deadline to waking up", idle, [f"next to {run.name}" for run in runs]),
    ):
        axes.hist(values_of, bins=bins, histtype="stepfilled", alpha=0.6, label=labels)
        axes.set_title(title, fontsize=10, loc="left")
        axes.set(ylabel="periods", yscale="log", xlim=(0.0, bins[-1]))
        axes.set_ylim(0.7, None)  # a single period is to be seen
        axes.grid(alpha=0.25)
        axes.legend(fontsize=8, loc="upper right")
    below.set_xlabel("ms")
    return figure
