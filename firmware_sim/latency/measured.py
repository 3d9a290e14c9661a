"""One run judged: quantiles of every stage and of the idle loop, misses, and the verdict in a line."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from typing import Any, Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from contract.arrays import Array
from contract.errors import StillwakeError
from firmware_sim.latency.idle_loop import between, lateness
from firmware_sim.latency.running import Recorded
from firmware_sim.latency.stages import Periods, Stage, Times, joined

LEFT_CONTROL: Final = 5
"""Periods in a row without a plan from which on the ECU was not in control: a lost frame or two leave fewer."""
NEEDED_FOR_P99_9: Final = 1_000
"""Values below which the 99.9th percentile by nearest rank is the maximum itself."""


class Quantiles(NamedTuple):
    """Percentiles of one stage, in ms: measured values, never between two of them; None where there was none."""

    p50: float | None
    p99: float | None
    p99_9: float | None
    max: float | None
    number: int

    @classmethod
    def of(cls, values_ns: Array) -> Self:
        """Percentiles of latencies in ns, (n,); NaN, a period without one, is left out, infinity is not."""
        values = values_ns[~np.isnan(values_ns)]
        if not len(values):
            return cls(None, None, None, None, 0)
        # By nearest rank: the smallest value that at least this share of all do not exceed.
        p50, p99, p99_9, most = np.quantile(values, [0.5, 0.99, 0.999, 1.0], method="inverted_cdf") / 1e6
        return cls(float(p50), float(p99), float(p99_9), float(most), len(values))


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredRun:
    """What one controller's run came to.

    Attributes:
        name: of the controller, for tables: "onnx" or "c".
        idle: rows of `IdleStage` of the same time.
    """

    name: str
    about: str
    recorded: Recorded
    periods: Periods
    idle: Times
    latencies: Mapping[Stage, Quantiles]

    @classmethod
    def of(cls, recorded: Recorded, *, name: str, about: str, period_ns: int, counter_period: int) -> Self:
        """Judge a run; raises StillwakeError where its tables hold none."""
        periods = joined(recorded.vehicle, recorded.ecu, period_ns=period_ns, counter_period=counter_period)
        begin = periods.origin_ns
        # A period more on both sides: the idle loop may sleep across the edge.
        idle = between(recorded.idle, begin - period_ns, begin + int(periods.scheduled[-1]) + period_ns)
        if not len(idle):
            raise StillwakeError("the idle loop did not run at the same time: there is no baseline")
        latencies = {stage: Quantiles.of(periods.values(stage)) for stage in Stage}
        return cls(name=name, about=about, recorded=recorded, periods=periods, idle=idle, latencies=latencies)

    @property
    def misses(self) -> int:
        """Commands that were not there by the boundary they were due at."""
        return len(self.periods.missed)

    @property
    def without_plan(self) -> int:
        """Periods whose command came by its boundary and rests on no plan."""
        return int(self._without_plan.sum())

    @property
    def left_control(self) -> bool:
        """Whether the ECU was out of control for a while, as after a fault: such a run measures no controller."""
        gaps = np.flatnonzero(np.diff(np.concatenate([[0], self._without_plan.astype(int), [0]]))).reshape(-1, 2)
        return bool(len(gaps)) and int((gaps[:, 1] - gaps[:, 0]).max()) >= LEFT_CONTROL

    @cached_property
    def _without_plan(self) -> NDArray[np.bool_]:
        without = np.isnan(self.periods.stages[Stage.PLAN])
        without[self.periods.missed] = False
        return without

    @cached_property
    def idle_late(self) -> Array:
        """Lateness of each period of the idle loop, ns after its deadline."""
        return lateness(self.idle, self.periods.period_ns)

    @property
    def idle_misses(self) -> int:
        """Periods in which the idle loop was late by the slack; a loop without slack misses because of itself."""
        return int((self.idle_late >= self.slack_ns).sum()) if self.slack_ns > 0.0 else 0

    @property
    def slack_ns(self) -> float:
        """What the median of the answer leaves of a period; NaN where there was no answer."""
        answers = self.periods.stages[Stage.ALL]
        answers = answers[np.isfinite(answers)]
        return self.periods.period_ns - float(np.median(answers)) if len(answers) else float("nan")

    @property
    def counts(self) -> dict[str, int]:
        """What a budget may limit of a run as a whole."""
        return {"misses": self.misses, "misses_ours": max(0, self.misses - self.idle_misses)}

    @property
    def is_too_noisy(self) -> bool:
        """Whether a loop that does nothing would have missed as well."""
        return self.idle_misses > 0

    @property
    def verdict(self) -> str:
        """The first line of a report."""
        total = len(self.periods)
        missed = f"{self.misses} of {total} commands missed their boundary."
        line = missed if self.misses else f"All {total} commands came by the boundary they were due at."
        if self.without_plan:
            line = f"{line} {self.without_plan} of them rest on no plan."
        if self.left_control:
            line = f"The ECU left control: {self.recorded.fault}. {line}"
        if not self.is_too_noisy:
            return line
        return (
            f"This machine is too noisy for a verdict: the idle loop itself was late by more than the slack of "
            f"{self.slack_ns / 1e6:.1f} ms in {self.idle_misses} periods. {line}"
        )

    def figures(self) -> dict[str, Any]:
        """Flat, for a results file; latencies in ms, None where there are none or one is infinite."""
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
    values = quantiles._asdict()
    del values["number"]
    return {f"{name}_ms": value if value is not None and isfinite(value) else None for name, value in values.items()}
