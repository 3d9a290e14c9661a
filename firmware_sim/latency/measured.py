"""The evaluation of one run: quantiles of every stage and of the idle loop, misses, and a one-line verdict."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from typing import Any, Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from contract.arrays import Array
from contract.errors import StillwakeError
from firmware_sim.latency.idle_loop import IdleStage, lateness
from firmware_sim.latency.running import Recorded
from firmware_sim.latency.stages import Periods, Stage, Times, joined

LEFT_CONTROL: Final = 5
"""Number of consecutive periods without a plan at which control counts as lost. Two lost frames cause fewer."""
NEEDED_FOR_P99_9: Final = 1_000
"""Smallest number of values for which the nearest-rank 99.9th percentile may differ from the maximum."""


class Quantiles(NamedTuple):
    """Percentiles of one stage's latency in ms, each of them a measured value; None if there are no values."""

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
        # The method gives the nearest rank: the smallest value that at least this share of the values does not exceed.
        p50, p99, p99_9, most = np.quantile(values, [0.5, 0.99, 0.999, 1.0], method="inverted_cdf") / 1e6
        return cls(float(p50), float(p99), float(p99_9), float(most), len(values))


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredRun:
    """The evaluated run of one controller, with the rows of the idle loop's table (`IdleStage`) during the run."""

    name: str
    about: str
    recorded: Recorded
    periods: Periods
    idle: Times
    latencies: Mapping[Stage, Quantiles]

    @classmethod
    def of(cls, recorded: Recorded, *, name: str, about: str, period_ns: int, counter_period: int) -> Self:
        """Evaluate a run; raises StillwakeError if its tables contain no usable periods."""
        periods = joined(recorded.vehicle, recorded.ecu, period_ns=period_ns, counter_period=counter_period)
        # The rows include one more period on each side, as the idle loop may sleep through the first or last instant.
        begin, end = periods.origin_ns - period_ns, periods.origin_ns + int(periods.scheduled[-1]) + period_ns
        scheduled = recorded.idle[:, IdleStage.SCHEDULED]
        idle = recorded.idle[(scheduled >= begin) & (scheduled <= end)]
        if not len(idle):
            raise StillwakeError("the idle loop did not run at the same time: there is no baseline")
        latencies = {stage: Quantiles.of(periods.values(stage)) for stage in Stage}
        return cls(name=name, about=about, recorded=recorded, periods=periods, idle=idle, latencies=latencies)

    @property
    def misses(self) -> int:
        """Number of commands that had not arrived by the end of their period."""
        return len(self.periods.missed)

    @property
    def without_plan(self) -> int:
        """Number of periods whose command arrived in time, but was computed without a plan."""
        return int(self._without_plan.sum())

    @property
    def left_control(self) -> bool:
        """Whether the ECU lost control, so that the run does not measure the controller."""
        gaps = np.flatnonzero(np.diff(np.concatenate([[0], self._without_plan.astype(int), [0]]))).reshape(-1, 2)
        return bool(len(gaps)) and int((gaps[:, 1] - gaps[:, 0]).max()) >= LEFT_CONTROL

    @cached_property
    def _without_plan(self) -> NDArray[np.bool_]:
        without = np.isnan(self.periods.stages[Stage.PLAN])
        without[self.periods.missed] = False
        return without

    @cached_property
    def idle_late(self) -> Array:
        """Delay in ns of each wake-up of the idle loop after its deadline."""
        return lateness(self.idle, self.periods.period_ns)

    @property
    def idle_misses(self) -> int:
        """Number of periods in which the idle loop woke at least `slack_ns` late; 0 if there is no slack."""
        return int((self.idle_late >= self.slack_ns).sum()) if self.slack_ns > 0.0 else 0

    @property
    def slack_ns(self) -> float:
        """Time in ns from the median arrival of the commands to the end of the period; NaN if no command arrived."""
        answers = self.periods.stages[Stage.ALL]
        answers = answers[np.isfinite(answers)]
        return self.periods.period_ns - float(np.median(answers)) if len(answers) else float("nan")

    @property
    def counts(self) -> dict[str, int]:
        """The counts over a whole run that a budget may limit."""
        return {"misses": self.misses, "misses_ours": max(0, self.misses - self.idle_misses)}

    @property
    def is_too_noisy(self) -> bool:
        return self.idle_misses > 0

    @property
    def verdict(self) -> str:
        """Text of the first line of a report."""
        total = len(self.periods)
        missed = f"{self.misses} of {total} commands missed their boundary."
        line = missed if self.misses else f"All {total} commands arrived by their boundary."
        if self.without_plan:
            line = f"{line} {self.without_plan} of them have no plan."
        if self.left_control:
            line = f"The ECU left control: {self.recorded.fault}. {line}"
        if not self.is_too_noisy:
            return line
        return (
            f"This machine is too noisy for a verdict: the idle loop itself was late by more than the slack of "
            f"{self.slack_ns / 1e6:.1f} ms in {self.idle_misses} periods. {line}"
        )

    def figures(self) -> dict[str, Any]:
        """Return the figures for a results file. Latencies are in ms; missing and infinite latencies are None."""
        idle = Quantiles.of(self.idle_late)
        return {
            "about": self.about,
            "verdict": self.verdict,
            "too_noisy": self.is_too_noisy,
            "period_ms": self.periods.period_ns / 1e6,
            "slack_ms": self.slack_ns / 1e6,
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
