"""Pictures of a run's latency: how often which, next to the idle loop, and what happened in the slowest period."""

from collections.abc import Sequence
from math import isfinite
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from contract.arrays import Array
from firmware_sim.latency.idle_loop import IdleStage
from firmware_sim.latency.measured import Measured
from firmware_sim.latency.stages import CHAIN, Stage

WIDTH: Final = 9.0
"""Inches."""
BINS: Final = 120
LONGEST_SHOWN: Final = 4
"""Periods of a timeline at most."""

_DRAWN: Final = {
    Stage.SAMPLE: ("vehicle", "#d95f02"),
    Stage.BUS_TO_ECU: ("bus", "#7570b3"),
    Stage.WAIT: ("ECU", "0.85"),
    Stage.RECEIVE: ("ECU", "#66a61e"),
    Stage.PLAN: ("ECU", "#1f78b4"),
    Stage.GATE: ("ECU", "#e6ab02"),
    Stage.BUS_TO_VEHICLE: ("bus", "#a6761d"),
}
"""Row and colour of each stage in a timeline."""
_ROWS: Final = ("idle loop", "ECU", "bus", "vehicle")
"""From below."""


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


def timeline_figure(run: Measured) -> Figure:
    """The period whose pressures waited longest for a command, and those after it until that command came."""
    periods = run.periods
    worst = int(np.nanargmax(periods.stages[Stage.ALL]))
    period_ms = periods.period_ns / 1e6
    waited_ms = float(periods.stages[Stage.ALL][worst]) / 1e6
    shown = min(waited_ms, LONGEST_SHOWN * period_ms) if isfinite(waited_ms) else LONGEST_SHOWN * period_ms
    origin = float(periods.scheduled[worst])
    first, last = max(0, worst - 1), min(len(periods) - 1, worst + int(shown // period_ms) + 1)
    figure = Figure(figsize=(WIDTH, 3.4), dpi=110, layout="constrained")
    axes = figure.subplots()
    for i in range(first, last + 1):
        _draw_period(axes, run, i, origin, strong=i == worst)
    _draw_idle(axes, run, origin, shown_ms=shown + period_ms)
    for i in range(first, last + 2):
        axes.axvline((i - worst) * period_ms, color="0.35", linewidth=0.9)
    axes.axvline(period_ms, color="tab:red", linewidth=1.4, linestyle="--")
    if isfinite(waited_ms):
        axes.axvline(waited_ms, color="black", linewidth=1.2, linestyle=":")
    axes.set_yticks(range(len(_ROWS)), _ROWS)
    axes.set_ylim(-0.6, len(_ROWS) - 0.4)
    axes.set_xlim(-0.25 * period_ms, max(shown, period_ms) + 0.25 * period_ms)
    axes.set_xlabel("ms after the sampling instant of the slowest period (red: its boundary; dotted: its answer)")
    took = f"{waited_ms:.2f} ms" if isfinite(waited_ms) else "never answered"
    came = "missed its boundary" if worst in periods.missed else "in time"
    axes.set_title(f"{run.name}, period {periods.first + worst}: {took}, {came}", fontsize=10, loc="left")
    patches = [Patch(color=colour, label=stage.value.replace("_", " ")) for stage, (_, colour) in _DRAWN.items()]
    figure.legend(handles=patches, loc="outside lower center", ncols=len(patches), frameon=False, fontsize=8)
    return figure


def _draw_period(axes: Axes, run: Measured, i: int, origin: float, *, strong: bool) -> None:
    """Bars of a period's stages one after another, as far as they happened."""
    at = (float(run.periods.scheduled[i]) - origin) / 1e6
    for stage in CHAIN:
        took = float(run.periods.stages[stage][i]) / 1e6
        if not isfinite(took):
            return
        row, colour = _DRAWN[stage]
        alpha = 1.0 if strong else 0.4
        axes.barh(_ROWS.index(row), took, left=at, height=0.62, color=colour, alpha=alpha, linewidth=0)
        at += took


def _draw_idle(axes: Axes, run: Measured, origin: float, *, shown_ms: float) -> None:
    """A bar from each deadline of the idle loop to its waking up; a mark where the bar is too short to be seen."""
    began = run.periods.origin_ns + origin
    rows = run.idle
    rows = rows[
        (rows[:, IdleStage.WOKE] > began - shown_ms * 1e6) & (rows[:, IdleStage.SCHEDULED] < began + shown_ms * 1e6)
    ]
    scheduled = (rows[:, IdleStage.SCHEDULED] - began) / 1e6
    late = (rows[:, IdleStage.WOKE] - rows[:, IdleStage.SCHEDULED]) / 1e6
    axes.barh(_ROWS.index("idle loop"), late, left=scheduled, height=0.62, color="0.3", linewidth=0)
    axes.plot(scheduled, np.full(len(rows), _ROWS.index("idle loop")), "|", color="0.3", markersize=9)


def _finite(values: Array) -> Array:
    return values[np.isfinite(values)]
