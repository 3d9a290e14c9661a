"""A report of a run's latency: rows of its tables, and the page of the report folder with a figure."""

from collections.abc import Iterator, Mapping, Sequence
from math import isinf
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from firmware_sim.latency.measured import NEEDED_FOR_P99_9, KeptLimit, MeasuredRun, Quantiles
from firmware_sim.latency.stages import Stage

_WIDTH: Final = 9.0
"""Width of the figure in inches."""
BINS: Final = 120


def histogram_figure(runs: Sequence[MeasuredRun]) -> Figure:
    """Plot histograms of the time from the sampling instant to the command, and of the idle loop's delays."""
    figure = Figure(figsize=(_WIDTH, 5.6), dpi=110, layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    period_ms = runs[0].periods.period_ns / 1e6
    everything = [run.periods.values(Stage.ALL) for run in runs]
    answers, idle = [values[np.isfinite(values)] / 1e6 for values in everything], [run.idle_late / 1e6 for run in runs]
    longest = max(float(values.max(initial=period_ms)) for values in (*answers, *idle))
    bins = np.linspace(0.0, 1.02 * longest, BINS + 1).tolist()
    above.axvline(period_ms, color="tab:red", linestyle="--", linewidth=1.2, label="boundary of the command")
    for axes, title, values_of, labels in (
        (above, "from the sampling instant to the command", answers, [f"{run.name}: {run.about}" for run in runs]),
        (below, "idle loop: from its deadline to waking up", idle, [f"next to {run.name}" for run in runs]),
    ):
        axes.hist(values_of, bins=bins, histtype="stepfilled", alpha=0.6, label=labels)
        axes.set_title(title, fontsize=10, loc="left")
        axes.set(ylabel="periods", yscale="log", xlim=(0.0, bins[-1]))
        axes.set_ylim(0.7, None)  # so that a bar of a single period is visible
        axes.grid(alpha=0.25)
        axes.legend(fontsize=8, loc="upper right")
    below.set_xlabel("ms")
    return figure


PAGE: Final = "report.md"
HEAD: Final = ("stage", "p50", "p99", "p99.9", "max", "misses")
BUDGET_HEAD: Final = ("limit", "allowed", "measured", "kept")

LABELS: Final[Mapping[Stage, str]] = {
    Stage.SAMPLE: "sample",
    Stage.BUS_TO_ECU: "bus to the ECU",
    Stage.WAIT: "wait for the step (intended)",
    Stage.RECEIVE: "receive",
    Stage.PLAN: "encode and plan",
    Stage.GATE: "gate",
    Stage.BUS_TO_VEHICLE: "bus to the vehicle",
    Stage.ALL: "in all: sampling instant to command",
    Stage.ACTUATE: "actuate, after the boundary",
}


def stage_rows(run: MeasuredRun) -> Iterator[tuple[str, ...]]:
    """Yield a row for each stage, and a row for the idle loop; times are in ms."""
    for stage, quantiles in run.latencies.items():
        yield (LABELS[stage], *_cells(quantiles), str(run.misses) if stage is Stage.ALL else "")
    yield ("idle loop of the same run", *_cells(Quantiles.of(run.idle_late)), str(run.idle_misses))


def notes(run: MeasuredRun) -> Iterator[str]:
    """Yield the notes that a reader needs to understand the rows."""
    periods = len(run.periods)
    yield f"{run.about}; {periods} periods of {run.periods.period_ns / 1e6:g} ms, {run.periods.planned} with a plan."
    if periods < NEEDED_FOR_P99_9:
        yield f"p99.9 of fewer than {NEEDED_FOR_P99_9} periods is their maximum."
    yield f"Slack, from the median to the end of the period: {run.slack_ns / 1e6:.2f} ms."
    yield f"Privileges: {run.recorded.privileges}."


def budget_rows(verdicts: Sequence[KeptLimit]) -> Iterator[tuple[str, ...]]:
    for verdict in verdicts:
        measured = "did not happen" if verdict.measured is None else f"{verdict.measured:.4g}"
        yield verdict.name, f"{verdict.allowed:g}", measured, "yes" if verdict.is_kept else "NO"


def write_report(folder: Path, runs: Sequence[MeasuredRun], budgets: Sequence[Sequence[KeptLimit]]) -> None:
    """Write the page and the figure into an existing folder. `budgets` has the compared limits of each run."""
    histogram_figure(runs).savefig(folder / "histogram.png")
    lines = [f"{run.name}: {run.verdict}\n" for run in runs]
    lines += ["# Latency of the control loop\n", "![how often which latency](histogram.png)\n"]
    for run, verdicts in zip(runs, budgets, strict=True):
        lines += [f"## {run.name}\n", *(f"{note}\n" for note in notes(run)), "Times in ms.\n"]
        lines.append(_table(HEAD, stage_rows(run)))
        if verdicts:
            lines += ["### Budget\n", _table(BUDGET_HEAD, budget_rows(verdicts))]
    (folder / PAGE).write_text("\n".join(lines), encoding="utf-8")


def _cells(quantiles: Quantiles) -> tuple[str, ...]:
    values = (quantiles.p50, quantiles.p99, quantiles.p99_9, quantiles.max)
    return tuple("" if value is None else ("never" if isinf(value) else f"{value:.2f}") for value in values)


def _table(head: Sequence[str], rows: Iterator[tuple[str, ...]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
