"""The vehicle's side of the bus: it samples the wall pressures and drives the jets as commanded.

With every period's pressures it also sends its speed, and the air's density where it knows it.

It drives them only while it wants control itself, and only by a command that is enabled, in a mode in which jets may
run, and that rests on pressures it sent not long ago. No single signal of a command decides. Where too many commands
are missing it gives up control by itself, and announces it on the bus: it no longer requests it (`heard_commands`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.receiver import E2eReceiver, ReceiverState
from can_bridge.e2e.sender import E2eSender
from can_bridge.secoc.node import Authentication, key_of, secured
from can_bridge.secoc.securing import Freshness, VerifierState, verified
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import DENSITY_RESOLUTION_KG_PER_M3, SPEED_RESOLUTION_M_PER_S, SPEED_UNKNOWN
from can_bridge.wire.messages import JetCommand, Mode, Pressure, VehicleSpeed
from contract.arrays import Array
from contract.config.tree import Config
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK
from ecu.controller_memory import DelayLine
from firmware_sim.bench.heard_commands import CommandLosses, EchoTracker

_DRIVING: Final = (Mode.CONTROL, Mode.HOLD, Mode.DECAY)


@dataclass(frozen=True, kw_only=True)
class Actuation:
    """What the jets' driver does in one control period.

    Attributes:
        action: to be reached at the period's end, U_inf W.
        command: the valid frame of the period; None if none came.
        next_period: the jets follow that frame in the next period, and in this one the frame before it.
        sampled_ns: when the pressures behind that command were sampled; None without one.
    """

    action: float
    command: Frame | None
    sampled_ns: int | None
    next_period: bool = False


class VehicleNode:
    """Four transducers and the jets' driver on one CAN node. Raises ConfigError if the plant has no sensor of that
    name, or one is named twice; or `bus.key` without `authentication`, or the other way round.

    Args:
        sensor_names: what the transducers are mounted on, in the order of the bundle.
        config: operating point, E2E and fail-safe settings.
        authentication: with `bus.key`, what the node needs of it.
        read: (Cp at the transducers (S,), time in ns) to what they read.

    Attributes:
        operating_point: of the vehicle itself; `config`'s unless it is set.
        action_limit: what its jets reach, U_inf W; likewise.
        stuck_at: where their actuator stands still, U_inf W; None for one that moves.
        speed: of the vehicle, m/s; `config`'s unless it is set. Pressures and jets do not scale with it.
        stated_speed: what the vehicle sends as its speed; None where it does not know it. One that does not fit the
            wire is sent as unknown.
        stated_density: likewise, kg/m3.
        sends_speed: whether it sends them at all.
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
        self._receiver = E2eReceiver(self._messages.command.spec, config.bus.e2e)
        self._key = key_of(authentication, config.bus)
        self._freshness, self._verifier = Freshness(), VerifierState()
        self._speed_freshness = self._freshness  # each message has its own
        if authentication is not None:
            self._freshness = self._speed_freshness = authentication.freshness
            self._verifier = authentication.verifier(self._receiver.spec)
        self._losses = CommandLosses.of(config.vehicle)
        self._misses = 0
        self._requested = False  # in the latest Pressure frame
        self._action = 0.0  # commanded last, U_inf W
        self._next_period = False  # by the command before
        self._driven_to = 0.0  # in the period before, without the actuator's delay
        self._commanded = DelayLine.filled(config.vehicle.actuator_delay)
        self._echo = EchoTracker(counter_period=profile_of(self._messages.pressure.spec).counter_period)
        # As old as the ECU's gate lets pressures be, and a period for computing and the way.
        self._oldest_echo = 2 + config.ecu.hold_periods + config.ecu.decay_periods
        self.frames_sent = 0

    def sample(self, cp: Array, *, enable_request: bool, now_ns: int, age_ns: int = 0) -> Frame:
        """The Pressure frame for the wall pressures Cp of all the plant's sensors, (n,), at the instant `now_ns`.

        It is handed over `age_ns` later. A pressure beyond the transducer's range saturates and is marked invalid; one
        that is no number is sent as 0. The request goes out as long as the vehicle has not given up control, which ends
        with a frame that does not want it.
        """
        losses = self._losses if enable_request else self._losses.cleared()
        requested = enable_request and not losses.is_latched
        pressure_pa = self._read(cp[self._columns], now_ns) * self.operating_point.dynamic_pressure
        limit = self._messages.pressure_limit_pa
        message = Pressure(
            pressure_pa=tuple(float(value) for value in np.nan_to_num(np.clip(pressure_pa, -limit, limit), nan=0.0)),
            valid=tuple(bool(value) for value in np.abs(pressure_pa) <= limit),
            enable_request=requested,
            age_ns=age_ns,
        )
        frame = self._sender.frame(self._messages.pressure.emit(message), now_ns=now_ns)
        self.frames_sent += 1
        self._losses, self._requested = losses, requested
        self._echo = self._echo.sent(profile_of(self._sender.spec).counter_of(frame.data), now_ns)
        frame = secured(frame, spec=self._sender.spec, key=self._key, freshness=self._freshness)
        self._freshness = self._freshness.next()
        return frame

    def speed_frame(self, *, now_ns: int, age_ns: int = 0) -> Frame | None:
        """The VehicleSpeed frame of the instant `now_ns`, handed over `age_ns` later; None while none is sent."""
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
        """What the jets do after one control period's frames.

        Without a valid command the last one stays for as long as the ECU itself would hold, then the jets shut. They
        shut at once when the vehicle no longer wants control, or gives it up because too many commands were missing.
        Commands for the next period act in it, one by one.
        """
        before = self._action
        spec = self._receiver.spec
        self._verifier, frames, _ = verified(self._verifier, frames, spec=spec, key=self._key)
        frame = self._receiver.tick(frames).live
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
        self._losses = (
            self._losses.lost() if command is None or self._is_too_old(command) else self._losses.heard(command.mode)
        )
        if self.has_given_up or not self._requested:
            self._action = before = 0.0
        if not self._next_period and self._action != 0.0:
            # After one for the next period, a command for this one leaps over the action that lay between.
            self._action = self._in_reach_of(self._driven_to, self._action)
        self._driven_to = before if self._next_period else self._action
        return Actuation(
            action=self._delayed(self._driven_to) if self.stuck_at is None else self.stuck_at,
            command=None if command is None else frame,
            sampled_ns=None if command is None else self._echo.sampled_ns,
            next_period=self._next_period,
        )

    def _driven(self, command: JetCommand) -> float:
        """The action that a command leads to, in U_inf W."""
        if not _drives(command) or self._is_too_old(command):
            return 0.0
        wanted = command.flow_m2_per_s / self.operating_point.flow_rate_scale
        limit = self.action_limit
        return float(np.clip(self._in_reach_of(self._action, wanted), -limit, limit))

    def _in_reach_of(self, action: float, wanted: float) -> float:
        """Go as far towards what is wanted as the driver goes in a period."""
        step = self._config.vehicle.action_step
        return float(np.clip(wanted, action - step, action + step))

    def _is_too_old(self, command: JetCommand) -> bool:
        """A command that would drive the jets, but rests on pressures that are."""
        age = self._echo.age
        return _drives(command) and (age is None or age > self._oldest_echo)

    def _delayed(self, action: float) -> float:
        """The action of `actuator_delay` periods ago, this one being the newest."""
        self._commanded = self._commanded.pushed(action)
        return self._commanded.in_force

    @property
    def foreseen_action(self) -> float:
        """What the jets will have reached at the end of the period whose pressures were sampled last, U_inf W, by the
        commands so far: one for the next period is for this one now."""
        if self.stuck_at is not None:
            return self.stuck_at
        return self._commanded.pushed(self._action if self._requested else 0.0).in_force

    @property
    def has_given_up(self) -> bool:
        """Too many commands were missing, and the vehicle's own request has not been low since."""
        return self._losses.is_latched

    @property
    def accepted_freshness(self) -> tuple[int, int]:
        """Identifier of the jet commands, and the newest freshness accepted with one; 0 without authentication."""
        return self._receiver.spec.frame_id, self._verifier.freshness

    @property
    def command_stream(self) -> ReceiverState:
        """What the receiving end of the jet commands found so far."""
        return self._receiver.state

    def counter_of(self, frame: Frame) -> int:
        """The E2E counter of a Pressure frame."""
        return profile_of(self._sender.spec).counter_of(frame.data)

    @property
    def frames_rejected(self) -> int:
        """Jet commands that came but were not authentic, or failed their end-to-end check."""
        return self.frames_not_authentic + self._receiver.state.frames_rejected

    @property
    def frames_not_authentic(self) -> int:
        """Jet commands refused by their MAC or freshness."""
        return self._verifier.refused


def _fitting(value: float | None, step: float, least: int, most: int) -> float | None:
    """The value, if the wire has so many steps for it."""
    return value if value is not None and least <= round(value / step) <= most else None


def _drives(command: JetCommand) -> bool:
    return command.enable and command.mode in _DRIVING
