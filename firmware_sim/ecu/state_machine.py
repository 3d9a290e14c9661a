"""What the ECU does when pressures stay away: hold, decay, zero and latch.

    miss 1 .. hold_periods              HOLD   keep the last command
    the next decay_periods misses       DECAY  halve it every period
    one more                            FAULT  zero, latched

A latched fault ends only when `rearm_frames` good frames in a row have come and the vehicle then raises its enable
request anew. Short of the latch, the first good frame resumes control.
"""

from dataclasses import dataclass, replace
from enum import Enum, auto

from can_bridge.wire.messages import Mode, Reason
from contract.config.vehicle import EcuConfig


class OperatingMode(Enum):
    """What the ECU does in a control period. The wire has a table of its own: see `on_wire`."""

    OFF = auto()
    """Control is not requested."""
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
        deadline_missed: steps were late so often in a row that the ECU must switch itself off.
    """

    usable: bool
    enable_request: bool | None
    unusable_because: Reason
    window_full: bool
    deadline_missed: bool = False


@dataclass(frozen=True, kw_only=True)
class FailSafe:
    """The state; `next` once a period, and `latch` if the period then ends in a fault, are the ways to change it.

    Attributes:
        mode: of the latest period.
        misses: periods in a row without usable pressures.
        good: usable ones in a row.
        latched: a fault that needs re-arming.
        reason: why the loop is not in control; kept while latched.
        enable_request: of the vehicle, as last received.
    """

    mode: OperatingMode = OperatingMode.OFF
    misses: int = 0
    good: int = 0
    latched: bool = False
    reason: Reason = Reason.NONE
    enable_request: bool = False

    def next(self, inputs: PeriodInputs, config: EcuConfig) -> "FailSafe":
        """The state in the next period; config has the lengths of hold, decay and re-arming."""
        before = self.latch(Reason.DEADLINE) if inputs.deadline_missed else self
        request = before.enable_request if inputs.enable_request is None else inputs.enable_request
        latched, reason = before.latched, before.reason
        if inputs.usable:
            misses, good = 0, before.good + 1
            edge = request and not before.enable_request
            latched = latched and not (edge and good >= config.rearm_frames)
        else:
            misses, good = before.misses + 1, 0
            if request and not latched:
                latched, reason = misses > config.hold_periods + config.decay_periods, inputs.unusable_because
        if not latched and (inputs.usable or not request):
            # A vehicle none of whose frames is authentic cannot make its wish heard: this alone says why.
            refused = not inputs.usable and inputs.unusable_because is Reason.NOT_AUTHENTIC
            reason = Reason.NOT_AUTHENTIC if refused else Reason.NONE
        if latched:
            mode = OperatingMode.FAULT
        elif not request:
            mode = OperatingMode.OFF
        elif not inputs.window_full:
            mode = OperatingMode.WARMUP
        elif misses == 0:
            mode = OperatingMode.CONTROL
        else:
            mode = OperatingMode.HOLD if misses <= config.hold_periods else OperatingMode.DECAY
        return FailSafe(mode=mode, misses=misses, good=good, latched=latched, reason=reason, enable_request=request)

    def latch(self, reason: Reason) -> "FailSafe":
        """Latch for a cause other than missing pressures; the good frames that re-arm are counted from here."""
        if self.latched:
            return self
        return replace(self, mode=OperatingMode.FAULT, good=0, latched=True, reason=reason)
