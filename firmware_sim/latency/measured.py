"""One run judged: quantiles of every stage and of the idle loop, misses with causes, and the verdict in a line."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any, Final, Self

from contract.arrays import Array
from contract.errors import StillwakeError
from firmware_sim.latency.attribution import Cause, Miss, attributed, counted, ours, slack_ns
from firmware_sim.latency.idle_times import IdleTimes
from firmware_sim.latency.quantiles import Quantiles
from firmware_sim.latency.running import Recorded
from firmware_sim.latency.stages import Periods, Stage, joined

WORST_SHOWN: Final = 20
"""Misses that a results file names one by one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """What one controller's run came to.

    Attributes:
        name: of the controller, for tables: "onnx" or "c".
        about: what ran, in words.
        recorded: the tables.
        periods: joined.
        idle: the idle loop's periods of the same time.
        latencies: of each stage.
        idle_latency: of waking up.
        idle_misses: periods in which the idle loop was late by more than the slack.
        misses: with their causes.
    """

    name: str
    about: str
    recorded: Recorded
    periods: Periods
    idle: IdleTimes
    latencies: Mapping[Stage, Quantiles]
    idle_latency: Quantiles
    idle_misses: int
    misses: list[Miss]

    @classmethod
    def of(cls, recorded: Recorded, *, name: str, about: str, period_ns: int, counter_period: int) -> Self:
        """Judge a run; raises StillwakeError where its tables hold none."""
        periods = joined(recorded.vehicle, recorded.ecu, period_ns=period_ns, counter_period=counter_period)
        begin = periods.origin_ns
        # A period more on both sides: the idle loop may sleep across the edge.
        idle = recorded.idle.between(begin - period_ns, begin + int(periods.scheduled[-1]) + period_ns)
        if not len(idle.rows):
            raise StillwakeError("the idle loop did not run at the same time: there is no baseline")
        late = idle.late(period_ns)
        return cls(
            name=name,
            about=about,
            recorded=recorded,
            periods=periods,
            idle=idle,
            latencies={stage: Quantiles.of(periods.values(stage)) for stage in Stage},
            idle_latency=Quantiles.of(late),
            idle_misses=_beyond(late, slack_ns(periods)),
            misses=attributed(periods, recorded.ecu, idle),
        )

    @property
    def counts(self) -> dict[str, int]:
        """What a budget may limit of a run as a whole."""
        unexplained = sum(miss.cause is Cause.UNKNOWN for miss in self.misses)
        return {"misses": len(self.misses), "misses_ours": ours(self.misses), "misses_unexplained": unexplained}

    @property
    def verdict(self) -> str:
        """The first line of a report."""
        total, own = len(self.misses), ours(self.misses)
        slack = slack_ns(self.periods) / 1e6
        if total:
            causes = ", ".join(f"{count} {cause}" for cause, count in counted(self.misses).items())
            found = (
                f"{total} of {len(self.periods)} commands missed their boundary; {own} of these are ours or "
                f"unexplained ({causes})."
            )
        else:
            found = f"All {len(self.periods)} commands came by the boundary they were due at."
        if self.is_too_noisy:
            return (
                f"This machine is too noisy for a verdict: the idle loop itself was late by more than the slack of "
                f"{slack:.1f} ms in {self.idle_misses} periods. {found}"
            )
        return found

    @property
    def is_too_noisy(self) -> bool:
        """Whether a loop that does nothing would have missed as well."""
        return self.idle_misses > 0

    def figures(self) -> dict[str, Any]:
        """Flat, for a results file; latencies in ms, None where there are none or one is infinite."""
        rows = {stage.value: _ms(quantiles) for stage, quantiles in self.latencies.items()}
        other = self.recorded.cyclictest
        return {
            "about": self.about,
            "verdict": self.verdict,
            "too_noisy": self.is_too_noisy,
            "period_ms": self.periods.period_ns / 1e6,
            "slack_ms": slack_ns(self.periods) / 1e6,
            "periods": len(self.periods),
            "periods_planned": self.periods.planned,
            **self.counts,
            "causes": {cause.name.lower(): count for cause, count in counted(self.misses).items()},
            "stages": {
                name: row | {"misses": sum(miss.stage == name for miss in self.misses)} for name, row in rows.items()
            }
            | {Stage.ALL.value: rows[Stage.ALL] | {"misses": len(self.misses)}},
            "baseline": _ms(self.idle_latency) | {"misses": self.idle_misses, "periods": self.idle_latency.number},
            "cyclictest": None if other is None else asdict(other),
            "privileges": self.recorded.privileges,
            "missed": [
                {
                    "period": miss.period,
                    "link": miss.link.value,
                    "stage": miss.stage.value,
                    "late_ms": miss.late_ms if isfinite(miss.late_ms) else None,
                    "cause": miss.cause.name.lower(),
                    "ours": miss.cause.is_ours,
                }
                for miss in sorted(self.misses, key=lambda miss: -miss.late_ms)[:WORST_SHOWN]
            ],
        }


def _beyond(late: Array, slack: float) -> int:
    """How often the idle loop was late by the slack; a loop without any misses by itself, not for its machine."""
    return int((late >= slack).sum()) if slack > 0.0 else 0


def _ms(quantiles: Quantiles) -> dict[str, Any]:
    values = {"p50_ms": quantiles.p50, "p99_ms": quantiles.p99, "p99_9_ms": quantiles.p99_9, "max_ms": quantiles.max}
    return {name: value if value is not None and isfinite(value) else None for name, value in values.items()}
