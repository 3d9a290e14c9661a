"""The vehicle's side of the bus: it samples the wall pressures and drives the jets as commanded."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.receiver import E2eReceiver
from can_bridge.e2e.sender import E2eSender
from can_bridge.secoc.freshness import Freshness
from can_bridge.secoc.node import Authentication, key_of, secured
from can_bridge.secoc.receiver import VerifierState, verified
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import Pressure
from contract.arrays import Array
from contract.config.tree import Config
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK
from firmware_sim.ecu.delay_line import DelayLine


@dataclass(frozen=True, kw_only=True)
class Actuation:
    """What the jets' driver does in one control period.

    Attributes:
        action: to be reached at the period's end, U_inf W.
        command: the frame it follows; None if no valid one came.
        sampled_ns: when the pressures behind that command were sampled; None without one.
    """

    action: float
    command: Frame | None
    sampled_ns: int | None


class VehicleNode:
    """Four transducers and the jets' driver on one CAN node.

    Args:
        sensor_names: what the transducers are mounted on, in the order of the bundle.
        config: operating point, E2E and fail-safe settings.
        layout: of the plant's sensors.
        authentication: with `bus.key`, what the node needs of it.

    Raises:
        ConfigError: the plant has no sensor of that name, or one is named twice; or `bus.key` without `authentication`,
            or the other way round.
    """

    def __init__(
        self,
        sensor_names: Sequence[str],
        config: Config,
        layout: SensorLayout = TRUCK,
        authentication: Authentication | None = None,
    ) -> None:
        self._columns = layout.indices(sensor_names)
        self._config = config
        self._messages = message_set(config.bus)
        self._sender = E2eSender(self._messages.pressure.spec)
        self._receiver = E2eReceiver(self._messages.command.spec, config.bus.e2e)
        self._key = key_of(authentication, config.bus)
        self._freshness, self._verifier = Freshness(), VerifierState()
        if authentication is not None:
            self._freshness = authentication.freshness
            self._verifier = authentication.verifier(self._receiver.spec)
        self._misses = 0
        self._action = 0.0  # commanded last, U_inf W
        self._commanded = DelayLine.filled(config.vehicle.actuator_delay)
        self._sampled_ns: dict[int, int] = {}  # by the counter of the Pressure frame
        self.frames_sent = 0

    def sample(self, cp: Array, *, enable_request: bool, now_ns: int) -> Frame:
        """The Pressure frame for the plant's wall pressures Cp of this instant.

        A pressure beyond the transducer's range saturates and is marked invalid.
        """
        pressure_pa = cp[self._columns] * self._config.operating_point.dynamic_pressure
        limit = self._messages.pressure_limit_pa
        message = Pressure(
            pressure_pa=tuple(float(value) for value in np.clip(pressure_pa, -limit, limit)),
            valid=tuple(bool(value) for value in np.abs(pressure_pa) <= limit),
            enable_request=enable_request,
            age_ns=0,
        )
        self.frames_sent += 1
        frame = self._sender.frame(self._messages.pressure.emit(message), now_ns=now_ns)
        self._sampled_ns[profile_of(self._sender.spec).counter_of(frame.data)] = now_ns
        frame = secured(frame, spec=self._sender.spec, key=self._key, freshness=self._freshness)
        self._freshness = self._freshness.next()
        return frame

    def apply_commands(self, frames: Sequence[Frame]) -> Actuation:
        """What the jets do after one control period's frames.

        Without a valid command the last one stays for as long as the ECU itself would hold, then the jets shut.
        """
        spec = self._receiver.spec
        self._verifier, frames, _ = verified(self._verifier, frames, spec=spec, key=self._key)
        frame = self._receiver.tick(frames).live
        command = None if frame is None else self._messages.command.parse(frame.data[: spec.protected])
        if command is None:
            self._misses += 1
            if self._misses > self._config.ecu.hold_periods:
                self._action = 0.0
            return Actuation(action=self._delayed_action(), command=None, sampled_ns=None)
        self._misses = 0
        flow = command.flow_m2_per_s if command.enable else 0.0
        limit = self._config.flow.action_limit
        self._action = float(np.clip(flow / self._config.operating_point.flow_rate_scale, -limit, limit))
        echoed = command.pressure_counter
        sampled_ns = None if echoed is None else self._sampled_ns.get(echoed)
        return Actuation(action=self._delayed_action(), command=frame, sampled_ns=sampled_ns)

    def _delayed_action(self) -> float:
        """The action of `actuator_delay` periods ago, the one commanded now being the newest."""
        self._commanded = self._commanded.pushed(self._action)
        return self._commanded.in_force

    @property
    def frames_rejected(self) -> int:
        """Jet commands that came but were not authentic, or failed their end-to-end check."""
        return self.frames_not_authentic + self._receiver.state.frames_rejected

    @property
    def frames_not_authentic(self) -> int:
        """Jet commands refused by their MAC or freshness."""
        return self._verifier.refused
