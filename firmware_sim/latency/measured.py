"""The evaluation of one run: quantiles of every stage and of the idle loop, misses, and a verdict in one line. The
module also reads a budget's limits from a TOML file, and writes tables and the report page with its figure."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, make_dataclass
from math import isfinite, isinf
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

import numpy as np
from matplotlib.figure import Figure

from contract.arrays import Array, runs
from contract.errors import ConfigError, StillwakeError
from contract.typed import read_toml, typed
from firmware_sim.latency.idle_loop import IdleStage, lateness
from firmware_sim.latency.running import Recorded
from firmware_sim.latency.stages import Periods, Stage, joined

LEFT_CONTROL: Final = 5
"""Number of consecutive periods without a plan at which control counts as lost. Two lost frames cause fewer periods."""
NEEDED_FOR_P99_9: Final = 1_000
"""Smallest number of values for which the nearest-rank 99.9th percentile may differ from the maximum."""
COUNTS: Final = ("misses", "misses_ours")
"""Counts over a whole run that a budget may limit: missed commands, and their excess over the idle loop's misses."""
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


class Quantiles(NamedTuple):
    """The percentiles of one stage's latency in ms. Each is a measured value, or None if there are no values."""

    p50: float | None
    p99: float | None
    p99_9: float | None
    max: float | None
    number: int

    @classmethod
    def of(cls, values_ns: Array) -> Self:
        """Compute the percentiles of n latencies in ns, shape (n,). NaN is left out; infinity counts as a latency."""
        values = values_ns[~np.isnan(values_ns)]
        if not len(values):
            return cls(None, None, None, None, 0)
        # The method gives the nearest rank: the smallest value with at least this share of the values at or below it.
        p50, p99, p99_9, most = np.quantile(values, [0.5, 0.99, 0.999, 1.0], method="inverted_cdf") / 1e6
        return cls(float(p50), float(p99), float(p99_9), float(most), len(values))


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredRun:
    """The evaluated run of one controller. `misses` commands had not arrived by the end of their period; `without_plan`
    commands arrived in time, but were computed without a plan. If `left_control`, the ECU lost control, so the run does
    not measure the controller. `slack_ns` is the time from the median arrival of the commands to the end of the period,
    NaN if no command arrived. `idle_late` has the delays in ns of the idle loop's next wake-up after its deadlines in
    the run; `idle_misses` counts the delays of at least the slack, and is 0 if there is no slack."""

    name: str
    about: str
    recorded: Recorded
    periods: Periods
    latencies: Mapping[Stage, Quantiles]
    misses: int
    without_plan: int
    left_control: bool
    slack_ns: float
    idle_late: Array
    idle_misses: int

    @classmethod
    def of(cls, recorded: Recorded, *, name: str, about: str, period_ns: int, counter_period: int) -> Self:
        """Evaluate a run; raises StillwakeError if its tables contain no usable periods."""
        periods = joined(recorded.vehicle, recorded.ecu, period_ns=period_ns, counter_period=counter_period)
        # The rows include one more period on each side, as the idle loop may sleep through the first or last instant.
        begin, end = periods.origin_ns - period_ns, periods.origin_ns + int(periods.scheduled[-1]) + period_ns
        scheduled = recorded.idle[:, IdleStage.SCHEDULED]
        idle = recorded.idle[(scheduled >= begin) & (scheduled <= end)]
        if not len(idle):
            raise StillwakeError("the idle loop did not run at the same time as the ECU: there is no baseline")
        without = np.isnan(periods.stages[Stage.PLAN])
        without[periods.missed] = False
        answers = periods.stages[Stage.ALL]
        answers = answers[np.isfinite(answers)]
        slack_ns = period_ns - float(np.median(answers)) if len(answers) else float("nan")
        late = lateness(idle, period_ns)
        return cls(
            name=name,
            about=about,
            recorded=recorded,
            periods=periods,
            latencies={stage: Quantiles.of(periods.values(stage)) for stage in Stage},
            misses=len(periods.missed),
            without_plan=int(without.sum()),
            left_control=any(end - begin >= LEFT_CONTROL for begin, end in runs(without)),
            slack_ns=slack_ns,
            idle_late=late,
            idle_misses=int((late >= slack_ns).sum()) if slack_ns > 0.0 else 0,
        )

    @property
    def counts(self) -> dict[str, int]:
        return {"misses": self.misses, "misses_ours": max(0, self.misses - self.idle_misses)}

    @property
    def is_too_noisy(self) -> bool:
        return self.idle_misses > 0

    @property
    def verdict(self) -> str:
        """The verdict on the run in one line, with which a report begins."""
        total = len(self.periods)
        missed = f"{self.misses} of {total} commands missed their boundary."
        line = missed if self.misses else f"All {total} commands arrived by their boundary."
        if self.without_plan:
            line = f"{line} {self.without_plan} of them have no plan."
        if self.left_control:
            line = f"The ECU left control: {self.recorded.fault}. {line}"
        if not self.is_too_noisy:
            return line
        slack = f"the slack of {self.slack_ns / 1e6:.1f} ms in {self.idle_misses} periods"
        return f"This machine is too noisy for a verdict: the idle loop itself was late by more than {slack}. {line}"

    def figures(self) -> dict[str, Any]:
        """Return the figures for a results file. Latencies are in ms; missing and infinite latencies are None."""
        idle = Quantiles.of(self.idle_late)
        return {
            "about": self.about,
            "verdict": self.verdict,
            "too_noisy": self.is_too_noisy,
            "period_ms": self.periods.period_ns / 1e6,
            "slack_ms": self.slack_ns / 1e6 if isfinite(self.slack_ns) else None,
            "periods": len(self.periods),
            "periods_planned": self.periods.planned,
            "left_control": self.left_control,
            **self.counts,
            "stages": {stage.value: _ms(quantiles) for stage, quantiles in self.latencies.items()},
            "baseline": _ms(idle) | {"misses": self.idle_misses, "periods": idle.number},
            "privileges": self.recorded.privileges,
        }


def _ms(quantiles: Quantiles) -> dict[str, Any]:
    values = zip(Quantiles._fields, quantiles[:-1], strict=False)
    return {f"{name}_ms": value if value is not None and isfinite(value) else None for name, value in values}


_StageForm: Final[Any] = make_dataclass(
    "_StageForm", [(f"{name}_ms", float | None, field(default=None)) for name in Quantiles._fields[:-1]]
)
"""The budget's limits of one stage's percentiles, in ms; None for no limit."""
_Form: Final[Any] = make_dataclass(
    "_Form",
    [
        *((name, int | None, field(default=None)) for name in COUNTS),
        *((stage.value, _StageForm, field(default_factory=_StageForm)) for stage in Stage),
    ],
)


class KeptLimit(NamedTuple):
    """A figure's limit and its measured value; the value is None if the stage did not occur in the run."""

    name: str
    allowed: float
    measured: float | None

    @property
    def is_kept(self) -> bool:
        return self.measured is not None and self.measured <= self.allowed


def read_budget(path: Path) -> dict[str, float]:
    """Read the limits of figures such as `all.p99_ms`. Raises ConfigError for a wrong limit, or without limits."""
    tree = read_toml(path, "budget")
    try:
        form = typed(tree, _Form)
    except ConfigError as error:
        raise ConfigError(f"budget {path}: {error}") from error
    of_stages = {f"{stage}.{name}": most for stage in Stage for name, most in vars(getattr(form, stage)).items()}
    limits = {name: getattr(form, name) for name in COUNTS} | of_stages
    budget = {name: most for name, most in limits.items() if most is not None}
    for name, most in budget.items():
        if name in COUNTS and most < 0:
            raise ConfigError(f"budget {path}: {name} = {most}: must be at least 0")
        if name in of_stages and not (isfinite(most) and most > 0.0):
            raise ConfigError(f"budget {path}: {name} = {most}: must be a positive number of ms")
    if not budget:
        raise ConfigError(f"budget {path}: has no limit; add a limit, for example misses_ours = 0")
    return budget


def verdicts(
    budget: Mapping[str, float], counts: Mapping[str, int], latencies: Mapping[Stage, Quantiles]
) -> list[KeptLimit]:
    measured: dict[str, float | None] = dict(counts)
    for stage, found in latencies.items():
        measured |= {f"{stage}.{name}_ms": value for name, value in found._asdict().items()}
    return [KeptLimit(name, allowed, measured[name]) for name, allowed in budget.items()]


def histogram_figure(runs: Sequence[MeasuredRun]) -> Figure:
    """Plot histograms of the time from the sampling instant to the command, and of the idle loop's delays."""
    figure = Figure(figsize=(9.0, 5.6), dpi=110, layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    period_ms = runs[0].periods.period_ns / 1e6
    everything = [run.periods.values(Stage.ALL) for run in runs]
    answers, idle = [values[np.isfinite(values)] / 1e6 for values in everything], [run.idle_late / 1e6 for run in runs]
    longest = max(float(values.max(initial=period_ms)) for values in (*answers, *idle))
    bins = np.linspace(0.0, 1.02 * longest, 121).tolist()
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
        for text in axes.legend(fontsize=8, loc="upper right").get_texts():
            text.set_parse_math(False)  # a bundle's name with two $ is no formula
    below.set_xlabel("ms")
    return figure


def stage_rows(run: MeasuredRun) -> Iterator[tuple[str, ...]]:
    """Yield a row for each stage, and a row for the idle loop; times are in ms."""
    for stage, quantiles in run.latencies.items():
        yield (LABELS[stage], *_cells(quantiles), str(run.misses) if stage is Stage.ALL else "")
    yield ("idle loop of the same run", *_cells(Quantiles.of(run.idle_late)), str(run.idle_misses))


def notes(run: MeasuredRun) -> Iterator[str]:
    """Yield the notes that explain the rows to a reader."""
    periods = len(run.periods)
    yield f"{run.about}; {periods} periods of {run.periods.period_ns / 1e6:g} ms, {run.periods.planned} with a plan."
    if periods < NEEDED_FOR_P99_9:
        yield f"p99.9 of fewer than {NEEDED_FOR_P99_9} periods is their maximum."
    slack = f"{run.slack_ns / 1e6:.2f} ms" if isfinite(run.slack_ns) else "not known, because no command arrived"
    yield f"Slack, from the median arrival of commands to the end of the period: {slack}."
    yield f"Privileges of the idle loop: {run.recorded.privileges}."


def budget_rows(verdicts: Sequence[KeptLimit]) -> Iterator[tuple[str, ...]]:
    for verdict in verdicts:
        measured = "did not happen" if verdict.measured is None else f"{verdict.measured:.4g}"
        yield verdict.name, f"{verdict.allowed:g}", measured, "yes" if verdict.is_kept else "NO"


def write_report(folder: Path, runs: Sequence[MeasuredRun], budgets: Sequence[Sequence[KeptLimit]]) -> None:
    """Write the page and the figure into an existing folder. `budgets` has the limits and values of each run."""
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
