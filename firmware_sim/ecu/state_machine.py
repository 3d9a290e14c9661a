"""What the ECU does when pressures stay away: hold, decay, zero and latch.

    miss 1 .. hold_periods              HOLD   keep the last command
    the next decay_periods misses       DECAY  halve it every period
    one more                            FAULT  zero, latched

A latched fault ends only when `rearm_frames` good frames in a row have come and the vehicle then raises its enable
request anew. Short of the latch, the first good frame resumes control.
"""

from dataclasses import dataclass, replace

from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import EcuConfig


@dataclass(frozen=True, kw_only=True)
class FailSafe:
    """The state; `next_state` is the only way to change it.

    Attributes:
        misses: periods in a row without usable pressures.
        good: usable ones in a row.
        latched: a fault that needs re-arming.
        reason: why the loop is not in control; kept while latched.
        enable_request: the vehicle's wish as last received.
    """

    misses: int = 0
    good: int = 0
    latched: bool = False
    reason: Reason = Reason.NONE
    enable_request: bool = False

    def next_state(self, *, usable: bool, enable_request: bool | None, reason: Reason, config: EcuConfig) -> "FailSafe":
        """The state after one period.

        Args:
            usable: a valid frame with four valid pressures came.
            enable_request: the wish in that frame; None if none came.
            reason: why pressures are not usable; ignored if they are.
            config: lengths of hold, decay and re-arming.
        """
        wish = self.enable_request if enable_request is None else enable_request
        if usable:
            good = self.good + 1
            edge = wish and not self.enable_request
            latched = self.latched and not (edge and good >= config.rearm_frames)
            why = self.reason if latched else Reason.NONE
            return FailSafe(good=good, latched=latched, reason=why, enable_request=wish)
        missed = replace(self, misses=self.misses + 1, good=0, enable_request=wish)
        if self.latched:
            return missed
        if not wish:
            return replace(missed, reason=Reason.NONE)
        return replace(missed, latched=missed.misses > config.hold_periods + config.decay_periods, reason=reason)

    def latch(self, reason: Reason) -> "FailSafe":
        """Latch for a cause other than missing pressures; the good frames that re-arm are counted from here."""
        return self if self.latched else replace(self, good=0, latched=True, reason=reason)

    def mode(self, *, window_full: bool, config: EcuConfig) -> Mode:
        """What the loop does in this period."""
        if self.latched:
            return Mode.FAULT
        if not self.enable_request:
            return Mode.OFF
        if not window_full:
            return Mode.WARMUP
        if self.misses == 0:
            return Mode.CONTROL
        return Mode.HOLD if self.misses <= config.hold_periods else Mode.DECAY
