"""The check that the ECU's steps are on time. It detects skipped periods, steps that are too early, and a clock that
stops or goes back.

The lateness of all steps is added up, so that many slightly late steps are detected as well as one very late step. When
the sum reaches half a period, a period counts as skipped. In every step the remaining sum is reduced by an eighth. If
a clock only runs a little slower or faster than the vehicle's clock, the sum therefore never reaches half a period. It
reaches half a period if steps are repeatedly late by more than a sixteenth of a period.
"""

from dataclasses import dataclass, replace
from typing import Final

from can_bridge.wire.messages import Reason
from contract.config.vehicle import EcuConfig

LATEST_NS: Final = 2**61
"""Largest valid clock value in ns (73 years). A larger value is an error, and so is a negative value. The difference of
two valid times fits into 64 bits, here and in the ECU in C."""


@dataclass(frozen=True, kw_only=True)
class StepTiming:
    """The timing after a control step.

    Attributes:
        step_ns: time of the step in ns, in -1..`LATEST_NS`; None before the first.
        lag_ns: accumulated lateness in ns, without the skipped periods; negative if early.
        off_time: one bit for each of the latest `ecu.deadline_window` steps, the lowest bit for the newest: 1 if the
            accumulated lateness or earliness reached half a period.
        skipped: number of whole periods skipped before the step.
    """

    step_ns: int | None = None
    lag_ns: int = 0
    off_time: int = 0
    skipped: int = 0
    fault: Reason | None = None

    def next(self, now_ns: int, period_ns: int, config: EcuConfig) -> "StepTiming":
        """Return the timing after the step at `now_ns`."""
        if not 0 <= now_ns <= LATEST_NS or (self.step_ns is not None and now_ns <= self.step_ns):
            held_ns = min(max(now_ns, -1), LATEST_NS)
            return replace(self, step_ns=held_ns, lag_ns=0, skipped=0, fault=Reason.CLOCK)
        if self.step_ns is None:
            return StepTiming(step_ns=now_ns)
        lag_ns = self.lag_ns + now_ns - self.step_ns - period_ns
        whole = (2 * lag_ns + period_ns) // (2 * period_ns)  # rounded to the nearest number
        off_time = lengthened(self.off_time, whole != 0, config.deadline_window)
        too_often = whole != 0 and off_time.bit_count() >= config.deadline_misses
        # Before a step this late, more periods passed without pressures than the fail-safe tolerates.
        away = whole > config.hold_periods + config.decay_periods
        fault = None
        if too_often or away:
            fault = Reason.DEADLINE if whole > 0 else Reason.CLOCK
        rest_ns = (lag_ns - whole * period_ns) * 7 // 8
        return StepTiming(step_ns=now_ns, lag_ns=rest_ns, off_time=off_time, skipped=max(0, whole), fault=fault)


def lengthened(history: int, newest: bool, most: int) -> int:
    """Return a history (a bit for each period) with `newest` as its lowest bit and at most `most` bits."""
    longer = history << 1 | newest
    # `most` is a setting and may be huge; the mask has no more bits than the history, so that it fits into memory.
    return longer & ((1 << min(most, longer.bit_length())) - 1)
