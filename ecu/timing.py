"""Whether the ECU's steps come on time: whole periods left out, steps too early, a clock that stands or goes back.

Lateness is added up, so that steps which are each a little late are seen as well as one that is very late: when half
a period has come together, a period was left out. An eighth of what is left is forgotten with every step, so that a
clock that differs a little from the vehicle's never adds up to a period; steps that are late by more than a
sixteenth of a period, again and again, do.
"""

from dataclasses import dataclass, replace
from typing import Final

from can_bridge.wire.messages import Reason
from contract.config.vehicle import EcuConfig

LATEST_NS: Final = 2**61
"""73 years: a clock beyond is as wrong as one before 0. Differences of times between have room in 64 bits, in the ECU's
C as here."""


@dataclass(frozen=True, kw_only=True)
class StepTiming:
    """The timing after a control step.

    Attributes:
        step_ns: its time; None before the first. -1 stands for any before 0, and `LATEST_NS` for any after that.
        lag_ns: how much later than due, beyond the periods left out; negative if early.
        off_time: the latest `ecu.deadline_window` steps, a bit each and the newest lowest: 1 if it was late or early.
        skipped: whole periods left out before it.
        fault: for which the ECU must switch itself off, if there is one.
    """

    step_ns: int | None = None
    lag_ns: int = 0
    off_time: int = 0
    skipped: int = 0
    fault: Reason | None = None

    def next(self, now_ns: int, period_ns: int, config: EcuConfig) -> "StepTiming":
        """Count the step at `now_ns`."""
        if not 0 <= now_ns <= LATEST_NS or (self.step_ns is not None and now_ns <= self.step_ns):
            held_ns = min(max(now_ns, -1), LATEST_NS)
            return replace(self, step_ns=held_ns, lag_ns=0, skipped=0, fault=Reason.CLOCK)
        if self.step_ns is None:
            return StepTiming(step_ns=now_ns)
        lag_ns = self.lag_ns + now_ns - self.step_ns - period_ns
        whole = (2 * lag_ns + period_ns) // (2 * period_ns)  # to the nearest
        off_time = (self.off_time << 1 | (whole != 0)) & ((1 << config.deadline_window) - 1)
        too_often = whole != 0 and off_time.bit_count() >= config.deadline_misses
        # Away for longer than it would bear the pressures to be away: the jets have shut meanwhile.
        away = whole > config.hold_periods + config.decay_periods
        fault = None
        if too_often or away:
            fault = Reason.DEADLINE if whole > 0 else Reason.CLOCK
        return StepTiming(
            step_ns=now_ns,
            lag_ns=(lag_ns - whole * period_ns) * 7 // 8,
            off_time=off_time,
            skipped=max(0, whole),
            fault=fault,
        )
