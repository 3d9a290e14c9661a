"""The vehicle's side of the bus: it samples the wall pressures and drives the jets as commanded.

In every period the vehicle sends the pressures, its speed, and the air's density if the density is known.

The jets run only while the vehicle itself wants control. They follow a command only if the command is enabled, has a
mode that drives the jets, and was computed from recent pressures. No single signal of a command can drive the jets.
If too many commands are missing, the vehicle gives up control and withdraws its request on the bus.

A command repeats ("echoes") the counter of the Pressure frame from which it was computed. The counter repeats after 256
frames, or after 16 frames in the classic message set, so an unchanged echo would look fresh again after that time. The
vehicle therefore assigns each echo to the first frame with the echoed counter that is not older than the previously
echoed frame. After an interruption it assigns the echo to the newest frame with that counter.

The limit of missed commands is (m, k)-firm, like the ECU's limit of missed pressures (`ecu.fail_safe`).
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from can_bridge.e2e.profiles import E2eSender, profile_of
from can_bridge.e2e.receiver import E2eReceiver
from can_bridge.secoc.securing import Authentication, Freshness, VerifierState, key_of, secured, verified
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import DENSITY_RESOLUTION_KG_PER_M3, SPEED_RESOLUTION_M_PER_S, SPEED_UNKNOWN
from can_bridge.wire.messages import JetCommand, Mode, Pressure, VehicleSpeed
from contract.arrays import Array
from contract.config.tree import Config
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK
from ecu.controller_memory import DelayLine


@dataclass(frozen=True, kw_only=True)
class EchoTracker:
    """An immutable record of sent Pressure frames and of the last echo. Frames are numbered: the first frame's number
    is its counter; the next frame's number is larger by the difference of the two counters, and so on. `kept` has the
    sending times in ns of the latest frames, at most `counter_period` of them, newest last. `newest` is the number of
    the newest frame, `echoed` that of the frame echoed last; None before it, after an interruption or wrong echo."""

    counter_period: int
    kept: tuple[int, ...] = ()
    newest: int | None = None
    echoed: int | None = None

    def sent(self, counter: int, now_ns: int) -> "EchoTracker":
        newest = counter if self.newest is None else self.newest + (counter - self.newest) % self.counter_period
        return replace(self, newest=newest, kept=(*self.kept, now_ns)[-self.counter_period :])

    def interrupted(self) -> "EchoTracker":
        """Delete the last echo, because commands were missing or contained no echo."""
        return replace(self, echoed=None)

    def received(self, counter: int) -> "EchoTracker":
        """Record the counter that a command echoes. If no sent frame can have this counter, delete the last echo."""
        if self.newest is None:
            return self
        oldest = self.newest - len(self.kept) + 1 if self.echoed is None else self.echoed
        number = oldest + (counter - oldest) % self.counter_period
        return replace(self, echoed=number if number <= self.newest else None)

    @property
    def age(self) -> int | None:
        """Number of frames sent since the frame that was echoed last; None without an echo."""
        return None if self.newest is None or self.echoed is None else self.newest - self.echoed

    @property
    def sampled_ns(self) -> int | None:
        """Sending time in ns of the frame echoed last; None without an echo, or if the frame is no longer stored."""
        age = self.age
        return self.kept[-1 - age] if age is not None and age < len(self.kept) else None


@dataclass(frozen=True, kw_only=True)
class Actuation:
    """The result of the jets' driver for one control period: the action at its end in U_inf W, the valid command frame
    that arrived in it, and the sampling time of this command's pressures; None without a command. With `next_period`
    the command acts only in the next period; until then the jets follow the previous command."""

    action: float
    command: Frame | None
    sampled_ns: int | None
    next_period: bool = False


class VehicleNode:
    """The transducers and the jets' driver on one CAN node. `sensor_names` are in the order of the bundle. `read` is a
    function from (Cp at the S transducers, shape (S,), time in ns) to their readings. Raises ConfigError if the plant
    lacks a sensor, if a name occurs twice, or if only one of `bus.key` and `authentication` is given.

    Attributes:
        operating_point, action_limit: the vehicle's own values, initially as in `config`.
        stuck_at: action at which the actuator is stuck, in U_inf W; None for an actuator that moves.
        speed: speed of the vehicle in m/s, initially as in `config`; pressures and jets scale with `operating_point`.
        stated_speed, stated_density: values that the vehicle sends, in m/s and kg/m3; None, or a value outside the
            signal's range, is sent as unknown.
        sends_speed: whether the vehicle sends VehicleSpeed frames.
        receiver: the receiver of jet commands, with its E2E state.
        has_given_up: whether too many commands were missed. It stays true until the vehicle no longer wants control.
    """

    def __init__(
        self,
        sensor_names: Sequence[str],
        config: Config,
        layout: SensorLayout = TRUCK,
        authentication: Authentication | None = None,
        read: Callable[[Array, int], Array] = lambda cp, now_ns: cp,
    ) -> None:
        self._columns = layout.indices(sensor_names)
        self._config = config
        self._read = read
        self.operating_point = config.operating_point
        self.action_limit = config.flow.action_limit
        self.stuck_at: float | None = None
        self.speed = config.operating_point.speed
        self.stated_speed: float | None = self.speed
        self.stated_density: float | None = None
        self.sends_speed = True
        self._messages = message_set(config.bus)
        self._sender = E2eSender(self._messages.pressure.spec)
        self._speed_sender = E2eSender(self._messages.speed.spec)
        self.receiver = E2eReceiver(self._messages.command.spec, config.bus.e2e)
        self._key = key_of(authentication, config.bus)
        self._freshness = Freshness() if authentication is None else authentication.freshness
        self._speed_freshness = self._freshness  # each message has its own freshness value
        self._verifier = VerifierState() if authentication is None else authentication.verifier(self.receiver.spec)
        # For each of the latest periods in which the ECU was in control: whether its command was missed.
        self._missed: deque[bool] = deque(maxlen=config.vehicle.loss_window)
        self.has_given_up = False
        self._misses = 0  # consecutive periods without a valid command
        self._requested = False  # request in the latest Pressure frame
        self._action = 0.0  # action commanded last, U_inf W
        self._next_period = False  # whether the latest command is for the next period
        self._driven_to = 0.0  # action of the latest period, before the actuator's delay
        self._commanded = DelayLine.filled(config.vehicle.actuator_delay)
        self._echo = EchoTracker(counter_period=profile_of(self._messages.pressure.spec).counter_period)
        # The ECU's command gate accepts ages of up to 1 + hold_periods + decay_periods; computing and way add one.
        self._oldest_echo = 2 + config.ecu.hold_periods + config.ecu.decay_periods
        self.frames_sent = 0

    def sample(self, cp: Array, *, enable_request: bool, now_ns: int, age_ns: int = 0) -> Frame:
        """Return the Pressure frame of the instant `now_ns`. The frame states that its pressures are `age_ns` old.
        `cp`, shape (n,), has the wall pressures Cp at all n sensors of the plant. A pressure beyond the transducer's
        range saturates, NaN becomes 0, and both are marked invalid. After the vehicle has given up control, its frames
        request no control until `enable_request` has been False once."""
        if not enable_request:
            self._missed.clear()
            self.has_given_up = False
        self._requested = enable_request and not self.has_given_up
        # Faults act on Cp, but transducers measure Pa: the configured dynamic pressure converts between both.
        scale = self._config.operating_point.dynamic_pressure
        present = cp[self._columns] * (self.operating_point.dynamic_pressure / scale)
        pressure_pa = self._read(present, now_ns) * scale
        limit = self._messages.pressure_limit_pa
        message = Pressure(
            pressure_pa=tuple(float(value) for value in np.nan_to_num(np.clip(pressure_pa, -limit, limit), nan=0.0)),
            valid=tuple(bool(value) for value in np.abs(pressure_pa) <= limit),
            enable_request=self._requested,
            age_ns=age_ns,
        )
        frame = self._sender.frame(self._messages.pressure.emit(message), now_ns=now_ns)
        self.frames_sent += 1
        self._echo = self._echo.sent(profile_of(self._sender.spec).counter_of(frame.data), now_ns)
        frame = secured(frame, spec=self._sender.spec, key=self._key, freshness=self._freshness)
        self._freshness = self._freshness.next()
        return frame

    def speed_frame(self, *, now_ns: int, age_ns: int = 0) -> Frame | None:
        """Return the VehicleSpeed frame, with time and age as in `sample`; None while the vehicle sends no speed."""
        if not self.sends_speed:
            return None
        message = VehicleSpeed(
            speed_m_per_s=_fitting(self.stated_speed, SPEED_RESOLUTION_M_PER_S, 0, SPEED_UNKNOWN - 1),
            age_ns=age_ns,
            density_kg_per_m3=_fitting(self.stated_density, DENSITY_RESOLUTION_KG_PER_M3, 1, 0xFF),
        )
        spec = self._speed_sender.spec
        frame = self._speed_sender.frame(self._messages.speed.emit(message), now_ns=now_ns)
        frame = secured(frame, spec=spec, key=self._key, freshness=self._speed_freshness)
        self._speed_freshness = self._speed_freshness.next()
        return frame

    def apply_commands(self, frames: Sequence[Frame]) -> Actuation:
        """Return the jets' action that follows from the frames received in one control period. Without a valid command
        the vehicle keeps the last action for `ecu.hold_periods` periods, like the ECU; then the jets shut. They shut
        immediately if the vehicle no longer wants control or gives up control."""
        before, spec = self._action, self.receiver.spec
        self._verifier, frames, _ = verified(self._verifier, frames, spec=spec, key=self._key)
        frame = self.receiver.tick(frames).live
        command = None if frame is None else self._messages.command.parse(frame.data[: spec.protected])
        if command is None:
            self._misses += 1
            if self._misses > self._config.ecu.hold_periods:
                self._echo = self._echo.interrupted()
                self._action = 0.0
        else:
            self._misses = 0
            echoed = command.pressure_counter
            self._echo = self._echo.interrupted() if echoed is None else self._echo.received(echoed)
            self._action = self._driven(command)
            self._next_period = command.next_period
        self._count(command)
        if self.has_given_up or not self._requested:
            self._action = before = 0.0
        if not self._next_period and self._action != 0.0:
            # This command replaces an earlier command for the same period, whose action the jets have not reached. So
            # the action is limited again to one step from the action that the jets have reached.
            self._action = self._in_reach_of(self._driven_to, self._action)
        self._driven_to = before if self._next_period else self._action
        self._commanded = self._commanded.pushed(self._driven_to)  # also while the jets are stuck
        action = self._commanded.in_force if self.stuck_at is None else self.stuck_at
        frame, sampled_ns = (None, None) if command is None else (frame, self._echo.sampled_ns)
        return Actuation(action=action, command=frame, sampled_ns=sampled_ns, next_period=self._next_period)

    def _count(self, command: JetCommand | None) -> None:
        """If the ECU is in control, record whether this period had a usable command."""
        if command is None or self._is_too_old(command):
            if self._missed:
                self._missed.append(True)
                self.has_given_up |= sum(self._missed) >= self._config.vehicle.loss_limit
        elif command.mode in (Mode.OFF, Mode.FAULT):
            self._missed.clear()
        else:
            self._missed.append(False)

    def _driven(self, command: JetCommand) -> float:
        if not _drives(command) or self._is_too_old(command):
            return 0.0
        wanted = command.flow_m2_per_s / self.operating_point.flow_rate_scale
        return float(np.clip(self._in_reach_of(self._action, wanted), -self.action_limit, self.action_limit))

    def _in_reach_of(self, action: float, wanted: float) -> float:
        """Return `action` moved towards `wanted` by at most the driver's step for one period."""
        step = self._config.vehicle.action_step
        return float(np.clip(wanted, action - step, action + step))

    def _is_too_old(self, command: JetCommand) -> bool:
        age = self._echo.age
        return _drives(command) and (age is None or age > self._oldest_echo)

    @property
    def foreseen_action(self) -> float:
        """The jets' action, in U_inf W, at the end of the period that has started with the latest pressures. It follows
        from the commands received so far, including a command for this period."""
        if self.stuck_at is not None:
            return self.stuck_at
        return self._commanded.pushed(self._action if self._requested else 0.0).in_force

    @property
    def accepted_freshness(self) -> tuple[int, int]:
        """Identifier of the jet commands, and their newest accepted freshness value (0 without authentication)."""
        return self.receiver.spec.frame_id, self._verifier.freshness

    def counter_of(self, frame: Frame) -> int:
        """Return the E2E counter of a Pressure frame."""
        return profile_of(self._sender.spec).counter_of(frame.data)

    @property
    def frames_rejected(self) -> int:
        """Number of jet commands received that were not authentic or failed their end-to-end check."""
        return self.frames_not_authentic + self.receiver.state.frames_rejected

    @property
    def frames_not_authentic(self) -> int:
        """Number of jet commands refused because of their MAC or freshness."""
        return self._verifier.refused


def _fitting(value: float | None, step: float, least: int, most: int) -> float | None:
    return value if value is not None and least <= round(value / step) <= most else None


def _drives(command: JetCommand) -> bool:
    return command.enable and command.mode in (Mode.CONTROL, Mode.HOLD, Mode.DECAY)
