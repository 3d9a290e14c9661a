"""The ECU's mode in each control period: one table of states and transitions.

`TRANSITIONS` is examined from its first row on. A control step takes the first row that starts at the present state and
whose condition is true in this step. `docs/reference/states.md` and its picture are made from the table.

The limit on losses follows (m, k)-firm control: at least m of any k consecutive periods must have usable pressures.
With default settings, control ends when `loss_limit` = 25 of the last `loss_window` = 50 periods have no usable
pressures, or when more than `hold_periods` + `decay_periods` = 3 consecutive periods have none.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Final, NamedTuple

from can_bridge.wire.messages import Mode, Reason
from contract.config.vehicle import EcuConfig
from ecu.timing import lengthened


class OperatingMode(Enum):
    """The ECU's mode in a control period. Messages on the bus use another enumeration: see `on_wire`."""

    INIT = auto()
    """There have been no usable pressures since power-on."""
    STANDBY = auto()
    """Pressures arrive. The vehicle's request for control has been high since power-on. The request may be older than a
    fault or a reset, so it must become low before control can start."""
    ARMED = auto()
    """The request for control is low; control starts when the request rises."""
    WARMUP = auto()
    """Control is requested but not yet active: the controller's window is not full, the speed is outside the range of
    the release, or the wake is being measured without jets to find out whether control helps."""
    CONTROL = auto()
    """The jets follow the controller."""
    HOLD = auto()
    """Pressures are missing; the last command is repeated."""
    DECAY = auto()
    """Pressures are missing for longer; the command is halved in each period."""
    FAULT = auto()
    """The jets are shut. They stay shut until frames with usable pressures have arrived and the request rises again."""
    UPDATE = auto()
    """A new release is being written (`updating` of `Ecu.step`); only a reset ends this mode."""

    @property
    def on_wire(self) -> Mode:
        """The mode as reported in JetCommand and EcuStatus: the mode of the same name; OFF while control is not due."""
        idle = (OperatingMode.INIT, OperatingMode.STANDBY, OperatingMode.ARMED, OperatingMode.UPDATE)
        return Mode.OFF if self in idle else Mode[self.name]

    @property
    def drives_jets(self) -> bool:
        return self in (OperatingMode.CONTROL, OperatingMode.HOLD, OperatingMode.DECAY)


@dataclass(frozen=True, kw_only=True)
class PeriodInputs:
    """The inputs of one control period.

    Attributes:
        usable: whether pressures arrived that the controller may use; otherwise `unusable_because` is the reason.
        enable_request: enable request of the vehicle; None if no frame arrived that may change it.
        off_speed: whether the vehicle is slower or faster than the range of speeds of the release.
        tests: whether the jets must be shut to measure the wake without control.
        fault: reason for which the ECU must switch itself off in this period, even if good frames arrived.
    """

    usable: bool
    enable_request: bool | None
    unusable_because: Reason
    window_full: bool
    off_speed: bool = False
    tests: bool = False
    fault: Reason | None = None
    updating: bool = False


class Period(NamedTuple):
    """The data from which conditions are evaluated: the inputs of one period, the latest request, whether the request
    rises, the counts of `FailSafe` including this period, and the reason that was reported before this period."""

    inputs: PeriodInputs
    request: bool
    rises: bool
    misses: int
    good: int
    lost: int
    config: EcuConfig
    kept: Reason


class Condition(NamedTuple):
    """A condition of a transition, and its description."""

    text: str
    holds: Callable[[Period], bool]


class Because(NamedTuple):
    """The rule that chooses the Reason to report in a state, and the rule's description."""

    text: str
    of: Callable[[Period], Reason]


def _missing(period: Period) -> Reason:
    return Reason.NONE if period.inputs.usable else period.inputs.unusable_because


def _waiting(period: Period) -> Reason:
    if period.inputs.usable and period.inputs.off_speed:
        return Reason.OFF_SPEED
    return Reason.NOT_HELPING if period.inputs.usable and period.inputs.tests else _missing(period)


def _unless_refused(reason: Reason) -> Callable[[Period], Reason]:
    """Return a rule that gives `reason`, or NOT_AUTHENTIC if requests are refused because no frame is authentic."""
    return lambda period: Reason.NOT_AUTHENTIC if _missing(period) is Reason.NOT_AUTHENTIC else reason


_NO_REASON: Final = Because("NONE", lambda period: Reason.NONE)
_WRITING: Final = Because("UPDATING", lambda period: Reason.UPDATING)
_QUIET: Final = Because("NONE; NOT_AUTHENTIC if no frame is", _unless_refused(Reason.NONE))
_STANDS: Final = Because("NOT_ARMED; NOT_AUTHENTIC if no frame is", _unless_refused(Reason.NOT_ARMED))
_MISSING: Final = Because("why pressures are missing", _missing)
_WAITING: Final = Because("NONE; OFF_SPEED at such a speed; NOT_HELPING in a test; why pressures are missing", _waiting)
_OWN: Final = Because("of the fault", lambda period: period.inputs.fault or Reason.INTERNAL)
_FIRST: Final = Because("the first reason stays", lambda period: period.kept)

ALWAYS: Final = Condition("in any other case", lambda p: True)
UPDATING: Final = Condition("a release is being written", lambda p: p.inputs.updating)
OWN_FAULT: Final = Condition(
    "the ECU's own fault: clock, deadline, bus-off, sensors, another ECU, no benefit, controller",
    lambda p: p.inputs.fault is not None,
)
REARMED: Final = Condition(
    "the request rises with usable pressures, `rearm_frames` or more in a row",
    lambda p: p.inputs.usable and p.rises and p.good >= p.config.rearm_frames,
)
LOW: Final = Condition("the request is low", lambda p: not p.request)
NEVER_YET: Final = Condition(
    "no usable pressures, and the request does not rise", lambda p: not (p.inputs.usable or p.rises)
)
LOW_AND_USABLE: Final = Condition(
    "usable pressures, and the request is low", lambda p: p.inputs.usable and not p.request
)
STANDING: Final = Condition(
    "usable pressures, and the request was already high", lambda p: p.inputs.usable and not p.rises
)
INVALID: Final = Condition("the pressure stream is invalid", lambda p: _missing(p) is Reason.STREAM_INVALID)
TOO_LONG: Final = Condition(
    "more than `hold_periods` + `decay_periods` missing in a row",
    lambda p: p.misses > p.config.hold_periods + p.config.decay_periods,
)
TOO_MANY: Final = Condition(
    "`loss_limit` of the last `loss_window` missing, the present period included",
    lambda p: not p.inputs.usable and p.lost >= p.config.loss_limit,
)
FILLING: Final = Condition(
    "the window is not full, the release is not made for the speed, or a test of control is in progress",
    lambda p: p.inputs.off_speed or p.inputs.tests or not p.inputs.window_full,
)
REARMED_FILLING: Final = Condition(f"{REARMED.text}; {FILLING.text}", lambda p: REARMED.holds(p) and FILLING.holds(p))
USABLE: Final = Condition("usable pressures", lambda p: p.inputs.usable)
SHORT: Final = Condition("no more than `hold_periods` missing in a row", lambda p: p.misses <= p.config.hold_periods)


@dataclass(frozen=True)
class Transition:
    """A row of the table: if the mode is in `start` and the condition `when` is true, the next mode is `to`.

    Attributes:
        within: number of periods after which the ECU reacts (1: in the first period of the cause), or its formula.
    """

    start: frozenset[OperatingMode]
    when: Condition
    to: OperatingMode
    reason: Because
    within: str = "1"


def _row(start: str, when: Condition, to: OperatingMode, reason: Because, within: str = "1") -> Transition:
    return Transition(frozenset(OperatingMode[name] for name in start.split()), when, to, reason, within)


_S = OperatingMode
_WANTED: Final = "WARMUP CONTROL HOLD DECAY"
"""States in which control is requested and there is no fault."""

TRANSITIONS: Final = (
    _row("UPDATE", ALWAYS, _S.UPDATE, _WRITING),
    _row("INIT STANDBY ARMED WARMUP FAULT", UPDATING, _S.UPDATE, _WRITING),
    _row(f"INIT STANDBY ARMED {_WANTED}", OWN_FAULT, _S.FAULT, _OWN),
    _row("FAULT", OWN_FAULT, _S.FAULT, _FIRST),
    # In these rows the request for control is low, or it is high but the ECU has not accepted it.
    _row("INIT", NEVER_YET, _S.INIT, _QUIET),
    _row("INIT", LOW_AND_USABLE, _S.ARMED, _QUIET),
    _row("INIT", STANDING, _S.STANDBY, _STANDS),
    _row(f"STANDBY ARMED {_WANTED}", LOW, _S.ARMED, _QUIET),
    _row("STANDBY", ALWAYS, _S.STANDBY, _STANDS),
    # In these rows the request rises, or is high and has been accepted earlier.
    _row(f"INIT ARMED {_WANTED}", INVALID, _S.FAULT, _MISSING),
    _row(f"INIT ARMED {_WANTED}", TOO_LONG, _S.FAULT, _MISSING, "hold_periods + decay_periods + 1"),
    _row(f"INIT ARMED {_WANTED}", TOO_MANY, _S.FAULT, _MISSING, "loss_limit"),
    _row("INIT", ALWAYS, _S.WARMUP, _WAITING),
    _row(f"ARMED {_WANTED}", FILLING, _S.WARMUP, _WAITING),
    _row(f"ARMED {_WANTED}", USABLE, _S.CONTROL, _NO_REASON),
    _row("ARMED WARMUP CONTROL HOLD", SHORT, _S.HOLD, _MISSING),
    _row(f"ARMED {_WANTED}", ALWAYS, _S.DECAY, _MISSING, "hold_periods + 1"),
    # These rows end a latched fault or keep it latched.
    _row("FAULT", REARMED_FILLING, _S.WARMUP, _WAITING, "rearm_frames"),
    _row("FAULT", REARMED, _S.CONTROL, _NO_REASON, "rearm_frames"),
    _row("FAULT", ALWAYS, _S.FAULT, _FIRST),
)
"""All transitions, in the order in which they are examined; see `Transition`."""
_FROM: Final = {mode: [row for row in TRANSITIONS if mode in row.start] for mode in OperatingMode}
_NO_LIMITS: Final = EcuConfig()
"""Any valid settings: the table's rows for the ECU's own faults depend on no setting."""


@dataclass(frozen=True, kw_only=True)
class FailSafe:
    """The state of the fail-safe. `next` computes it in each period; `latch` adds a fault that is found after `next`.

    Attributes:
        misses: number of consecutive periods without usable pressures.
        good: number of consecutive periods with usable pressures, since the latest fault of the ECU itself.
        lost: one bit for each of the latest `loss_window` periods since control was requested or re-armed: 1 for a
            period without usable pressures. The lowest bit is for the newest period.
        reason: reason why the ECU is not in control; constant during a fault.
        enable_request: latest enable request of the vehicle. It counts as high before the first request, and when a
            fault begins, unless the frame of that period states that it is low.
    """

    mode: OperatingMode = OperatingMode.INIT
    misses: int = 0
    good: int = 0
    lost: int = 0
    reason: Reason = Reason.NONE
    enable_request: bool = True

    def next(self, inputs: PeriodInputs, config: EcuConfig) -> "FailSafe":
        """Return the state after a period with these inputs."""
        request = self.enable_request if inputs.enable_request is None else inputs.enable_request
        rises = request and not self.enable_request
        usable = inputs.usable
        misses = 0 if usable else self.misses + 1
        # Good frames help to end a fault only if they came after the latest fault of the ECU itself.
        good = (self.good + 1 if inputs.fault is None else 1) if usable else 0
        lost = 0
        is_wanted = request and (rises or self.mode not in (_S.INIT, _S.STANDBY, _S.ARMED))
        if is_wanted and inputs.fault is None and self.mode not in (_S.FAULT, _S.UPDATE):
            lost = lengthened(self.lost, not usable, config.loss_window)
        period = Period(inputs, request, rises, misses, good, lost.bit_count(), config, self.reason)
        row = taken(self.mode, period)
        if row.to is OperatingMode.FAULT is not self.mode:
            # As after power-on, the request must first be low: a rise that the ECU missed must not end the fault.
            request = inputs.enable_request is not False
        return FailSafe(
            mode=row.to, misses=misses, good=good, lost=lost, reason=row.reason.of(period), enable_request=request
        )

    def latch(self, reason: Reason) -> "FailSafe":
        """Return the state after a fault of the ECU itself that is found in this period."""
        own = PeriodInputs(usable=False, enable_request=None, unusable_because=reason, window_full=False, fault=reason)
        period = Period(own, self.enable_request, False, self.misses, 0, 0, _NO_LIMITS, self.reason)
        row = taken(self.mode, period)
        return replace(self, mode=row.to, good=0, lost=0, reason=row.reason.of(period))


def taken(mode: OperatingMode, period: Period) -> Transition:
    """Return the row of the table for this mode and period. The condition of a mode's last row is always true."""
    *rows, otherwise = _FROM[mode]
    for row in rows:
        if row.when.holds(period):
            return row
    return otherwise
