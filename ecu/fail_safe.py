"""What the ECU does in each control period: one table of states and transitions, and nothing else.

`TRANSITIONS` is read from its first row on; the first one that starts at the present state and whose condition holds
is taken, in the control step that sees the condition. `docs/reference/states.md` and its picture are made from it.

The ECU takes no more losses than (m, k)-firm control allows: with the settings as they are, control is taken away when
`loss_limit` = 25 of the last `loss_window` = 50 periods have no usable pressures, or when more than `hold_periods` +
`decay_periods` = 3 in a row have none.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final, NamedTuple

from can_bridge.wire.messages import Mode, Reason
from contract.config.vehicle import EcuConfig


class OperatingMode(Enum):
    """What the ECU does in a control period. The wire has a table of its own: see `on_wire`."""

    INIT = auto()
    """Since power-on there have been no usable pressures."""
    STANDBY = auto()
    """Pressures come. The vehicle's request for control stands as it did at power-on: it may be of the time before a
    fault, so it must fall first."""
    ARMED = auto()
    """The request is low: control starts when it rises."""
    WARMUP = auto()
    """Control is wanted, but the controller's window is not full, the speed is not one that the release serves, or the
    wake is measured without jets, to find whether control helps."""
    CONTROL = auto()
    """The jets follow the controller."""
    HOLD = auto()
    """Pressures are missing: the last command stays."""
    DECAY = auto()
    """They are missing for longer: the command is halved each period."""
    FAULT = auto()
    """The jets are shut and stay so until good frames have come and the request rises again."""
    UPDATE = auto()
    """A new release is being written (`updating` of `Ecu.step`); a reset alone leads out."""

    @property
    def on_wire(self) -> Mode:
        """How JetCommand and EcuStatus report it."""
        return _ON_WIRE[self]

    @property
    def drives_jets(self) -> bool:
        """Whether the jets may run."""
        return self in DRIVES_JETS


_ON_WIRE: Final = {
    **dict.fromkeys((OperatingMode.INIT, OperatingMode.STANDBY, OperatingMode.ARMED, OperatingMode.UPDATE), Mode.OFF),
    OperatingMode.WARMUP: Mode.WARMUP,
    OperatingMode.CONTROL: Mode.CONTROL,
    OperatingMode.HOLD: Mode.HOLD,
    OperatingMode.DECAY: Mode.DECAY,
    OperatingMode.FAULT: Mode.FAULT,
}
DRIVES_JETS: Final = frozenset({OperatingMode.CONTROL, OperatingMode.HOLD, OperatingMode.DECAY})


@dataclass(frozen=True, kw_only=True)
class PeriodInputs:
    """What one control period brings.

    Attributes:
        usable: a valid frame with four valid pressures came.
        enable_request: of the vehicle, in that frame; None if none came.
        unusable_because: why pressures are not usable; ignored if they are.
        window_full: the controller can plan.
        off_speed: the vehicle is slower or faster than the release is made for.
        tests: the jets must be shut to measure the wake without them.
        fault: for which the ECU must switch itself off in this period, whatever came.
        updating: a new release is to be written.
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
    """What conditions are about: one period's inputs, and what has been counted up to it.

    Attributes:
        request: of the vehicle, as last received.
        rises: it was low before this period and stands now.
        misses: periods in a row without usable pressures.
        good: usable ones in a row.
        lost: periods without usable pressures among the latest `loss_window` in which control was wanted.
        kept: reason of the state before.
    """

    inputs: PeriodInputs
    request: bool
    rises: bool
    misses: int
    good: int
    lost: int
    config: EcuConfig
    kept: Reason


class Condition(NamedTuple):
    """A condition by its name."""

    text: str
    holds: Callable[[Period], bool]


class Because(NamedTuple):
    """Which Reason a state is reported with, by its name."""

    text: str
    of: Callable[[Period], Reason]


def _missing(period: Period) -> Reason:
    return Reason.NONE if period.inputs.usable else period.inputs.unusable_because


def _waiting(period: Period) -> Reason:
    if period.inputs.usable and period.inputs.off_speed:
        return Reason.OFF_SPEED
    return Reason.NOT_HELPING if period.inputs.usable and period.inputs.tests else _missing(period)


def _unless_refused(reason: Reason) -> Callable[[Period], Reason]:
    """A vehicle none of whose frames is authentic cannot make its request heard: the reason alone says why."""
    return lambda period: Reason.NOT_AUTHENTIC if _missing(period) is Reason.NOT_AUTHENTIC else reason


_NO_REASON: Final = Because("NONE", lambda period: Reason.NONE)
_WRITING: Final = Because("UPDATING", lambda period: Reason.UPDATING)
_QUIET: Final = Because("NONE; NOT_AUTHENTIC if no frame is", _unless_refused(Reason.NONE))
_STANDS: Final = Because("NOT_ARMED; NOT_AUTHENTIC if no frame is", _unless_refused(Reason.NOT_ARMED))
_MISSING: Final = Because("why pressures are missing", _missing)
_WAITING: Final = Because("NONE; OFF_SPEED at such a speed; NOT_HELPING in a test; why pressures are missing", _waiting)
_OWN: Final = Because("of the fault", lambda period: period.inputs.fault or Reason.INTERNAL)
_FIRST: Final = Because("the first one stays", lambda period: period.kept)

ALWAYS: Final = Condition("in any other case", lambda period: True)
UPDATING: Final = Condition("a release is to be written", lambda period: period.inputs.updating)
OWN_FAULT: Final = Condition(
    "the ECU's own fault: clock, deadline, bus-off, sensors, another ECU, no benefit, controller",
    lambda period: period.inputs.fault is not None,
)
REARMED: Final = Condition(
    "the request rises with usable pressures, `rearm_frames` or more in a row",
    lambda period: period.inputs.usable and period.rises and period.good >= period.config.rearm_frames,
)
LOW: Final = Condition("the request is low", lambda period: not period.request)
NEVER_YET: Final = Condition(
    "no usable pressures, and the request does not rise", lambda period: not (period.inputs.usable or period.rises)
)
LOW_AND_USABLE: Final = Condition(
    "usable pressures, and the request is low", lambda period: period.inputs.usable and not period.request
)
STANDING: Final = Condition(
    "usable pressures, and the request stands from before", lambda period: period.inputs.usable and not period.rises
)
INVALID: Final = Condition("the stream is not to be trusted", lambda period: _missing(period) is Reason.STREAM_INVALID)
TOO_LONG: Final = Condition(
    "more than `hold_periods` + `decay_periods` missing in a row",
    lambda period: period.misses > period.config.hold_periods + period.config.decay_periods,
)
TOO_MANY: Final = Condition(
    "`loss_limit` of the last `loss_window` missing, this one too",
    lambda period: not period.inputs.usable and period.lost >= period.config.loss_limit,
)
FILLING: Final = Condition(
    "the window is not full, the release is not made for the speed, or a test is whether control helps",
    lambda period: period.inputs.off_speed or period.inputs.tests or not period.inputs.window_full,
)
USABLE: Final = Condition("usable pressures", lambda period: period.inputs.usable)
SHORT: Final = Condition(
    "no more than `hold_periods` missing in a row", lambda period: period.misses <= period.config.hold_periods
)


@dataclass(frozen=True, kw_only=True)
class Transition:
    """One row of the table.

    Attributes:
        within: periods from the first that has the cause to the one that reacts, which is 1 for the same: a number,
            or a formula in settings of the ECU.
    """

    start: frozenset[OperatingMode]
    when: Condition
    to: OperatingMode
    reason: Because
    within: str = "1"


def _row(start: str, when: Condition, to: OperatingMode, reason: Because, within: str = "1") -> Transition:
    states = frozenset(OperatingMode[name] for name in start.split())
    return Transition(start=states, when=when, to=to, reason=reason, within=within)


_S = OperatingMode
_WANTED: Final = "WARMUP CONTROL HOLD DECAY"
"""Where control is wanted and no fault stands."""

TRANSITIONS: Final = (
    _row("UPDATE", ALWAYS, _S.UPDATE, _WRITING),
    _row("INIT STANDBY ARMED WARMUP FAULT", UPDATING, _S.UPDATE, _WRITING),
    _row(f"INIT STANDBY ARMED {_WANTED}", OWN_FAULT, _S.FAULT, _OWN),
    _row("FAULT", OWN_FAULT, _S.FAULT, _FIRST),
    # Power-on, and no request.
    _row("INIT", NEVER_YET, _S.INIT, _QUIET),
    _row("INIT", LOW_AND_USABLE, _S.ARMED, _QUIET),
    _row("INIT", STANDING, _S.STANDBY, _STANDS),
    _row(f"STANDBY ARMED {_WANTED}", LOW, _S.ARMED, _QUIET),
    _row("STANDBY", ALWAYS, _S.STANDBY, _STANDS),
    # The request rises, or it stands and control is wanted.
    _row(f"INIT ARMED {_WANTED}", INVALID, _S.FAULT, _MISSING),
    _row(f"INIT ARMED {_WANTED}", TOO_LONG, _S.FAULT, _MISSING, "hold_periods + decay_periods + 1"),
    _row(f"INIT ARMED {_WANTED}", TOO_MANY, _S.FAULT, _MISSING, "loss_limit"),
    _row("INIT", ALWAYS, _S.WARMUP, _WAITING),
    _row(f"ARMED {_WANTED}", FILLING, _S.WARMUP, _WAITING),
    _row(f"ARMED {_WANTED}", USABLE, _S.CONTROL, _NO_REASON),
    _row("ARMED WARMUP CONTROL HOLD", SHORT, _S.HOLD, _MISSING),
    _row(f"ARMED {_WANTED}", ALWAYS, _S.DECAY, _MISSING, "hold_periods + 1"),
    # A latched fault.
    _row(
        "FAULT",
        Condition(f"{REARMED.text}; {FILLING.text}", lambda p: REARMED.holds(p) and FILLING.holds(p)),
        _S.WARMUP,
        _WAITING,
        "rearm_frames",
    ),
    _row("FAULT", REARMED, _S.CONTROL, _NO_REASON, "rearm_frames"),
    _row("FAULT", ALWAYS, _S.FAULT, _FIRST),
)
"""All that can happen, in the order in which it is looked at; see `Transition`."""


def _rows_of(mode: OperatingMode) -> tuple[list[Transition], Transition]:
    """The rows of a state in their order, and the last one, which asks for nothing."""
    *rows, otherwise = (row for row in TRANSITIONS if mode in row.start)
    return rows, otherwise


_FROM: Final = {mode: _rows_of(mode) for mode in OperatingMode}
_UNWANTED: Final = frozenset({_S.INIT, _S.STANDBY, _S.ARMED})
_COUNTS_NO_LOSS: Final = frozenset({_S.FAULT, _S.UPDATE})


@dataclass(frozen=True, kw_only=True)
class FailSafe:
    """The state; `next` once a period, and `latch` if the period then ends in a fault, are the ways to change it.

    Attributes:
        misses: periods in a row without usable pressures.
        good: usable ones in a row.
        lost: the latest `loss_window` periods, a bit each and the newest lowest: 1 without usable pressures. Those
            since control was requested or re-armed.
        reason: why the loop is not in control; kept while a fault stands.
        enable_request: of the vehicle, as last received; taken to stand before the first, and when a fault begins.
    """

    mode: OperatingMode = OperatingMode.INIT
    misses: int = 0
    good: int = 0
    lost: int = 0
    reason: Reason = Reason.NONE
    enable_request: bool = True

    def next(self, inputs: PeriodInputs, config: EcuConfig) -> "FailSafe":
        """The state in the next period; config has the lengths of hold, decay and re-arming and the most losses."""
        request = self.enable_request if inputs.enable_request is None else inputs.enable_request
        rises = request and not self.enable_request
        usable = inputs.usable
        misses = 0 if usable else self.misses + 1
        # Good frames that re-arm are counted from the last period with a fault of the ECU's own.
        good = (self.good + 1 if inputs.fault is None else 1) if usable else 0
        lost = 0
        if (
            request
            and inputs.fault is None
            and self.mode not in _COUNTS_NO_LOSS
            and (rises or self.mode not in _UNWANTED)
        ):
            lost = (self.lost << 1 | (not usable)) & ((1 << config.loss_window) - 1)
        period = Period(inputs, request, rises, misses, good, lost.bit_count(), config, self.reason)
        row = taken(self.mode, period)
        if row.to is OperatingMode.FAULT is not self.mode:
            # As at power-on: it must be seen low from now on, or a rise that was not heard would end the fault.
            request = inputs.enable_request is not False
        return FailSafe(
            mode=row.to, misses=misses, good=good, lost=lost, reason=row.reason.of(period), enable_request=request
        )

    def latch(self, reason: Reason) -> "FailSafe":
        """Latch a fault of the ECU's own that shows only in the course of the period; good frames count from here."""
        inputs = PeriodInputs(
            usable=False, enable_request=None, unusable_because=reason, window_full=False, fault=reason
        )
        request, misses = self.enable_request, self.misses
        period = Period(inputs, request, False, misses, 0, 0, _NO_LIMITS, self.reason)
        row = taken(self.mode, period)
        return FailSafe(
            mode=row.to, misses=misses, good=0, lost=0, reason=row.reason.of(period), enable_request=request
        )


_NO_LIMITS: Final = EcuConfig()
"""The settings for rows of a fault of the ECU's own, which look at none."""


def taken(mode: OperatingMode, period: Period) -> Transition:
    """The row that a period takes from a state. There always is one: the last row of each state asks for nothing."""
    rows, otherwise = _FROM[mode]
    for row in rows:
        if row.when.holds(period):
            return row
    return otherwise
