"""The invariants that hold in every control period under any disturbance; the checks see only frames and plant.

On the bus, for every JetCommand that the ECU sends:

    bus_bounds      the flow is within the action limit; the flow is 0 if `Enable` is off, and `Enable` is on only in
                    modes that drive the jets
    bus_rate        the flow differs from the previous flow by at most `ecu.command_step`, unless it goes to 0
    bus_age         in CONTROL the command's pressures are at most `ecu.pressure_age` periods old, as far as the ECU can
                    tell; in HOLD and DECAY the largest age follows from `ecu.hold_periods` and `ecu.decay_periods`
    enable_edge     after OFF, FAULT or a restart (visible in the command's counter), the ECU prepares or takes control
                    only after it has received a frame without a request and then a frame with a request

At the jets, for the action reached at the end of every period:

    jets_shut       the action is 0, unless the vehicle received a command that drives the jets and was computed from
                    recent pressures of this vehicle. The command must have arrived in the deciding period (below), or
                    before it, within the time for which the vehicle keeps the last command's action
    jets_request    the action is 0 if the vehicle did not want control
    jets_losses     the action is 0 after `vehicle.loss_limit` of the latest `vehicle.loss_window` periods under control
                    had no command, until the vehicle withdraws its request
    jets_bounds     the action is within the action limit
    jets_rate       the action differs from the previous action by at most `vehicle.action_step`, unless it is 0

Without a delay, the deciding period is the period in which the jets reach the action. With `ecu.plan_ahead` it is one
period earlier, and with `vehicle.actuator_delay` it is earlier by this delay. A command that shuts the jets is
considered only if the vehicle certainly accepted it, as the next command of a stream without errors. So the checks are
one-sided: if frames are lost or damaged, a violation may be missed, but a false violation is never reported.

`Commands` and `Jets` check values, not frames, for the proofs in `tests/proofs/ecu`, which have their own parser.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Self, TypeVar

from can_bridge.bus.faults.fault import NS
from can_bridge.bus.faults.node_faults import ClockDrift
from can_bridge.e2e.profiles import profile_of
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import Message, message_set
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import JetCommand, Mode
from contract.config.tree import Config
from firmware_sim.bench.disturbances import Disturbances, NodeFault, StuckJets
from wake.plant.sample import Sample

T = TypeVar("T")
DRIVING: Final = frozenset({Mode.CONTROL, Mode.HOLD, Mode.DECAY})
_WANTED: Final = DRIVING | {Mode.WARMUP}  # modes of an ECU that was asked for control and has no latched fault
AGE_TOLERANCE: Final = 0.01
"""Tolerance of ages, as a share of a period. It is far larger than the known errors of an age: those from clock rates
that differ by 200 ppm, and from the time between a frame's arrival and the reading of the bus."""
ROUNDING: Final = 1e-9
"""Tolerance for the rounding of floating-point numbers that are compared with a limit."""


@dataclass(frozen=True, kw_only=True)
class Violation:
    """A violation of an invariant. Periods count from 0; `detail` has the values that violate the invariant."""

    period: int
    invariant: str
    detail: str


class HeardCommand(NamedTuple):
    """A command that the vehicle received without errors."""

    counter: int
    wanted: bool  # whether the mode implies that the ECU has received a request for control
    drives: bool  # whether the command is enabled and its mode drives the jets
    in_time: bool  # whether the command was computed from recent pressures of this vehicle


class _Period(NamedTuple):
    """The properties of the commands that the vehicle received in one period."""

    drives: bool  # whether a command may drive the jets
    old: bool  # whether a command could drive the jets, but its pressures are too old
    shuts: bool  # whether no command may drive the jets, and the vehicle certainly accepted the last command


class Commands:
    """The checks of an ECU's commanded flow rates. `bus_shut` is the part of `bus_bounds` that concerns `Enable`."""

    def __init__(self, config: Config) -> None:
        scale = config.operating_point.flow_rate_scale
        self._limit, self._step = config.flow.action_limit * scale, config.ecu.command_step * scale
        self.flow = 0.0

    def reach(self, share: float = 1.0) -> float:
        """Return the allowed change of flow rate (m2/s) in `share` of a period, including the signal's resolution."""
        return self._step * share + FLOW_RESOLUTION_M2_PER_S

    def broken(self, flow: float, *, enable: bool, drives: bool, share: float = 1.0) -> Iterator[tuple[str, str]]:
        """Yield (name, values) of each invariant that a command violates, `share` periods (at most 1) after another."""
        before, self.flow = self.flow, flow
        if abs(flow) > self._limit + ROUNDING:
            yield "bus_bounds", f"{flow:g} m2/s, limit {self._limit:g}"
        if (enable and not drives) or (not enable and flow != 0.0):
            what = "drives" if drives else "does not drive"
            yield "bus_shut", f"{flow:g} m2/s, enable {enable}, in a mode that {what}"
        if enable and abs(flow - before) > self.reach(share) + ROUNDING:
            yield "bus_rate", f"{before:g} to {flow:g} m2/s, at most {self.reach(share):g}"


class Jets:
    """The checks of the vehicle's jets. At the end of each period call `heard`, then `broken` with the action reached.
    `oldest` is the largest allowed age, in periods, of the pressures of a command that drives the jets."""

    def __init__(self, config: Config) -> None:
        vehicle, self._e2e_window = config.vehicle, config.bus.e2e.window
        self.oldest = 2 + config.ecu.hold_periods + config.ecu.decay_periods
        self._counters = profile_of(message_set(config.bus).command.spec).counter_period
        self._limit, self._step = config.flow.action_limit, vehicle.action_step
        self._loss_limit, self._loss_window = vehicle.loss_limit, vehicle.loss_window
        self._late, self._hold = vehicle.actuator_delay, config.ecu.hold_periods
        self._decides_after = config.ecu.plan_ahead + self._late
        self.reset()

    def reset(self) -> None:
        """Return to the state after the vehicle's power-on."""
        self._heard: deque[_Period] = deque(maxlen=self._decides_after + self._hold + 1)
        self._requested: deque[bool] = deque(maxlen=1 + self._late)
        self._gave_up: deque[bool] = deque([False], maxlen=1 + self._late)
        self._silent: deque[bool] = deque(maxlen=self._loss_window)  # whether a period under control had no command
        self._counter: int | None = None
        self._sound = 0  # consecutive periods with only the expected command
        self._action = 0.0

    def heard(self, commands: Sequence[HeardCommand | None], *, requested: bool) -> None:
        """Record the commands of a period; a command with errors is None."""
        last = None
        for command in commands:
            if command is None:
                self._sound = 0
                continue
            follows = self._counter is None or (command.counter - self._counter) % self._counters == 1
            self._sound = self._sound if follows else 0
            self._counter, last = command.counter, command
        self._sound = self._sound + 1 if len(commands) == 1 and last is not None else 0
        known = [command for command in commands if command is not None]
        drives = any(command.drives and command.in_time for command in known)
        # The receiver's E2E state depends only on the latest frames. If they had no errors, the next frame is accepted.
        believed = last is not None and self._sound > self._e2e_window
        old = any(command.drives and not command.in_time for command in known)
        self._heard.append(_Period(drives=drives, old=old, shuts=believed and not drives))
        self._requested.append(requested)
        if not requested or any(not command.wanted for command in known):
            self._silent.clear()
        elif believed or self._silent:
            self._silent.append(not commands)
        self._gave_up.append(requested and (self._gave_up[-1] or sum(self._silent) >= self._loss_limit))

    def broken(self, action: float) -> Iterator[tuple[str, str]]:
        """Yield (name, values) of each invariant that the action at the end of the latest period violates."""
        before, self._action = self._action, action
        if not self._heard:
            return
        if not abs(action) <= self._limit * (1.0 + ROUNDING):
            yield "jets_bounds", f"action {action:g}, limit {self._limit:g}"
        if action == 0.0:
            return
        if not abs(action - before) <= self._step * (1.0 + ROUNDING):
            yield "jets_rate", f"action {before:g} to {action:g}, at most {self._step:g} in a period"
        if len(self._requested) == self._requested.maxlen and not self._requested[0]:
            yield "jets_request", f"action {action:g} where control was not requested"
        if len(self._gave_up) == self._gave_up.maxlen and self._gave_up[0]:
            yield "jets_losses", f"action {action:g} after too many periods without a command"
        # The first item is the deciding period; the following items are the periods before it, newest first.
        deciding = list(self._heard)[: len(self._heard) - self._decides_after][::-1]
        for period in deciding:
            if period.drives:
                return
            if period.shuts:
                break
        why = "pressures too old" if any(period.old for period in deciding) else "no command that drives jets"
        yield "jets_shut", f"action {action:g}: {why}"


class Invariants:
    """An observer that records violations of the invariants. It sees the nodes' frames and the plant, but no state of
    the nodes. Its methods are called in the order of time. A command's pressures may be older than they appear to the
    ECU by `hidden_ns` ns, and by `drift` s per s of the run. Jets whose actuator is stuck are not checked."""

    def __init__(self, config: Config, *, hidden_ns: int = 0, drift: float = 0.0, jets_follow: bool = True) -> None:
        self._config, self._jets_follow, self._hidden_ns, self._drift = config, jets_follow, hidden_ns, drift
        messages = message_set(config.bus)
        self._pressure, self._command = messages.pressure, messages.command
        self.violations: list[Violation] = []
        self._period = 0
        self._commands = Commands(config)
        self._counters = profile_of(self._command.spec).counter_period
        self._last_counter: int | None = None  # counter of the ECU's latest command
        self._was_wanted = self._low_heard = self._edge_heard = False
        self._jets = Jets(config)
        self._sampled: dict[int | None, tuple[int, int]] = {}  # counter of a Pressure frame: (period, time in ns)
        self._reached: dict[int | None, int] = {}  # same keys: time stamp in ns of the first such frame at the ECU
        self._arrived: list[Frame] = []

    @classmethod
    def of(cls, config: Config, disturbances: Disturbances) -> Self:
        """Return the invariants of a run with these disturbances. Pressures stamped while the ECU's clock was ahead
        appear too young; the check of ages allows for this."""
        hidden_s = drift = 0.0
        for one in disturbances.items:
            if isinstance(one, NodeFault) and one.node == "ecu" and isinstance(one.fault, ClockDrift):
                hidden_s += max(0.0, one.fault.offset_s)
                drift += max(0.0, one.fault.ppm) / 1e6
        jets_follow = not any(isinstance(one, StuckJets) for one in disturbances.items)
        return cls(config, hidden_ns=round(hidden_s * NS), drift=drift, jets_follow=jets_follow)

    def frame(self, frame: Frame, *, node: str, sent: bool, now_ns: int) -> None:
        """Check a frame that the node's software sends or receives now, before or after faults of the node's port."""
        if node == "vehicle":
            if sent and self._pressure.spec.names(frame):
                self._sampled[profile_of(self._pressure.spec).counter_of(frame.data)] = self._period, now_ns
            elif not sent and self._command.spec.names(frame):
                self._arrived.append(frame)
        elif sent:
            if (command := parsed(self._command, frame)) is not None:
                self._judge_command(command, profile_of(self._command.spec).counter_of(frame.data), now_ns)
        elif (pressure := parsed(self._pressure, frame)) is not None:
            counter = profile_of(self._pressure.spec).counter_of(frame.data)
            if self._reached.get(counter, -1) < self._sampled.get(counter, (0, 0))[1]:
                self._reached[counter] = min(frame.timestamp_ns, now_ns)
            self._edge_heard |= self._low_heard and pressure.enable_request
            self._low_heard |= not pressure.enable_request

    def period(self, sample: Sample, *, requested: bool) -> None:
        """End a control period. `sample` is from the period's start, `requested` whether the vehicle wanted control."""
        self.finished(sample)
        frames, self._arrived = self._arrived, []
        self._jets.heard([self._read(frame) for frame in frames], requested=requested)
        self._period += 1

    def finished(self, sample: Sample) -> None:
        """Check the action at the end of the latest period whose frames have all been observed."""
        for invariant, detail in self._jets.broken(sample.action) if self._jets_follow else ():
            self.violations.append(Violation(period=self._period - 1, invariant=invariant, detail=detail))

    def _read(self, frame: Frame) -> HeardCommand | None:
        """Return a frame's command as the vehicle receives it; None if the frame is not a valid command."""
        command = parsed(self._command, frame)
        if command is None:
            return None
        sampled = self._sampled.get(command.pressure_counter)
        return HeardCommand(
            counter=profile_of(self._command.spec).counter_of(frame.data),
            wanted=command.mode in _WANTED,
            drives=command.enable and command.mode in DRIVING,
            in_time=sampled is not None and self._period - sampled[0] <= self._jets.oldest,
        )

    def _judge_command(self, command: JetCommand, counter: int, now_ns: int) -> None:
        flow, drives = command.flow_m2_per_s, command.mode in DRIVING
        if self._last_counter is None or (counter - self._last_counter) % self._counters != 1:
            self._was_wanted = False
        self._last_counter = counter
        for name, detail in self._commands.broken(flow, enable=command.enable, drives=drives):
            self._broken("bus_bounds" if name == "bus_shut" else name, f"{command.mode.name}: {detail}")
        if flow != 0.0 and drives and command.enable:
            self._judge_age(command, now_ns)
        wanted = command.mode in _WANTED
        if wanted and not self._was_wanted and not self._edge_heard:
            self._broken("enable_edge", f"{command.mode.name} without a request that was low before")
        if wanted:
            self._low_heard = self._edge_heard = False
        self._was_wanted = wanted

    def _judge_age(self, command: JetCommand, now_ns: int) -> None:
        ecu, period_ns = self._config.ecu, self._config.period_ns
        held = 1 + ecu.hold_periods + ecu.decay_periods
        oldest = min(ecu.pressure_age, held) if command.mode is Mode.CONTROL else held
        counter = command.pressure_counter
        if (sampled := self._sampled.get(counter)) is None:
            self._broken("bus_age", f"{command.mode.name} is based on pressures that were not sent (counter {counter})")
            return
        # The ECU does not see a delay before a frame's time stamp: in a gateway that gives new time stamps, in a wait
        # for the bus, or in a transmit buffer that is sent again. The checks of the vehicle's jets use the true age.
        known_ns = max(sampled[1], self._reached.get(counter, 0))
        age_ns = now_ns - round(ecu.compute_time_ms * 1e6) - known_ns
        if age_ns > (oldest + AGE_TOLERANCE) * period_ns + self._hidden_ns + self._drift * now_ns:
            self._broken("bus_age", f"{command.mode.name} is based on pressures that are {age_ns / 1e6:g} ms old")

    def _broken(self, invariant: str, detail: str) -> None:
        self.violations.append(Violation(period=self._period, invariant=invariant, detail=detail))


def parsed(message: Message[T], frame: Frame) -> T | None:
    """Return the content of a frame; None if it belongs to another message or has a wrong end-to-end CRC."""
    spec = message.spec
    if not spec.names(frame) or len(frame.data) != spec.length:
        return None
    data = frame.data[: spec.protected]
    return message.parse(data) if profile_of(spec).check(data, data_id=spec.data_id) else None
