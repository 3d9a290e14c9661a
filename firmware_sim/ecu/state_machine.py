"""What the ECU does when pressures stay away: hold, decay, zero and latch.

    miss 1 .. hold_periods              HOLD   keep the last command
    the next decay_periods misses       DECAY  halve it every period
    one more                            FAULT  zero, latched
    loss_limit misses in loss_window    FAULT  zero, latched
    a stream that is not to be trusted  FAULT  zero, latched

A latched fault ends only when `rearm_frames` good frames in a row have come and the vehicle then raises its enable
request anew. Short of the latch, the first good frame resumes control. At power-on the request must be raised, too:
one that stands already may be of the time before a fault.
"""

from dataclasses import dataclass, replace
from enum import Enum, auto

from can_bridge.wire.messages import Mode, Reason
from contract.config.vehicle import EcuConfig


class OperatingMode(Enum):
    """What the ECU does in a control period. The wire has a table of its own: see `on_wire`."""

    OFF = auto()
    """Control is not requested, or has not been since power-on."""
    WARMUP = auto()
    """It is, but the window is not full."""
    CONTROL = auto()
    HOLD = auto()
    DECAY = auto()
    FAULT = auto()

    @property
    def on_wire(self) -> Mode:
        """How JetCommand and EcuStatus report it."""
        return _ON_WIRE[self]

    @property
    def drives_jets(self) -> bool:
        """Whether the jets may run."""
        return self in _DRIVES_JETS


_ON_WIRE = {
    OperatingMode.OFF: Mode.OFF,
    OperatingMode.WARMUP: Mode.WARMUP,
    OperatingMode.CONTROL: Mode.CONTROL,
    OperatingMode.HOLD: Mode.HOLD,
    OperatingMode.DECAY: Mode.DECAY,
    OperatingMode.FAULT: Mode.FAULT,
}
_DRIVES_JETS = frozenset({OperatingMode.CONTROL, OperatingMode.HOLD, OperatingMode.DECAY})


@dataclass(frozen=True, kw_only=True)
class PeriodInputs:
    """What one control period brings.

    Attributes:
        usable: a valid frame with four valid pressures came.
        enable_request: of the vehicle, in that frame; None if none came.
        unusable_because: why pressures are not usable; ignored if they are.
        window_full: the controller can plan.
        fault: for which the ECU must switch itself off in this period, whatever came.
    """

    usable: bool
    enable_request: bool | None
    unusable_because: Reason
    window_full: bool
    fault: Reason | None = None


@dataclass(frozen=True, kw_only=True)
class FailSafe:
    """The state; `next` once a period, and `latch` if the period then ends in a fault, are the ways to change it.

    Attributes:
        mode: of the latest period.
        misses: periods in a row without usable pressures.
        good: usable ones in a row.
        lost: the latest `loss_window` periods, a bit each and the newest lowest: 1 without usable pressures. Those
            since control was requested or re-armed.
        latched: a fault that needs re-arming.
        reason: why the loop is not in control; kept while latched.
        enable_request: of the vehicle, as last received; taken to stand before the first.
        armed: the request has been raised since power-on.
    """

    mode: OperatingMode = OperatingMode.OFF
    misses: int = 0
    good: int = 0
    lost: int = 0
    latched: bool = False
    reason: Reason = Reason.NONE
    enable_request: bool = True
    armed: bool = False

    def next(self, inputs: PeriodInputs, config: EcuConfig) -> "FailSafe":
        """The state in the next period; config has the lengths of hold, decay and re-arming and the most losses."""
        before = self if inputs.fault is None else self.latch(inputs.fault)
        request = before.enable_request if inputs.enable_request is None else inputs.enable_request
        edge = request and not before.enable_request
        armed = before.armed or edge
        wanted = armed and request
        latched, reason, lost = before.latched, before.reason, 0
        if wanted and not latched:
            lost = (before.lost << 1 | (not inputs.usable)) & ((1 << config.loss_window) - 1)
        if inputs.usable:
            misses, good = 0, before.good + 1
            # An edge is spent where a fault is new or stands.
            latched = latched and not (edge and good >= config.rearm_frames and inputs.fault is None)
        else:
            misses, good = before.misses + 1, 0
            if wanted and not latched:
                reason = inputs.unusable_because
                too_long = misses > config.hold_periods + config.decay_periods
                latched = too_long or lost.bit_count() >= config.loss_limit or reason is Reason.STREAM_INVALID
        if not latched and (inputs.usable or not wanted):
            reason = Reason.NONE
        if latched:
            mode = OperatingMode.FAULT
        elif not wanted:
            mode = OperatingMode.OFF
        elif not inputs.window_full:
            mode = OperatingMode.WARMUP
        elif misses == 0:
            mode = OperatingMode.CONTROL
        else:
            mode = OperatingMode.HOLD if misses <= config.hold_periods else OperatingMode.DECAY
        return FailSafe(
            mode=mode,
            misses=misses,
            good=good,
            lost=lost,
            latched=latched,
            reason=reason,
            enable_request=request,
            armed=armed,
        )

    def latch(self, reason: Reason) -> "FailSafe":
        """Latch for a cause other than missing pressures; the good frames that re-arm are counted from here.

        Of a fault that is latched already the first cause is kept.
        """
        first = self.reason if self.latched else reason
        return replace(self, mode=OperatingMode.FAULT, good=0, lost=0, latched=True, reason=first)
