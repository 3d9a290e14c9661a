"""An ECU without a release. It keeps the jets shut, reports the reason, and can be flashed."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Unpack

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.command_gate import Intervention
from can_bridge.secoc.securing import Authentication, key_of
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import SENSORS, JetCommand, Reason
from contract.config.tree import Config
from ecu.ecu_state import EcuState, Surroundings, Trace, answers
from ecu.fail_safe import FailSafe, OperatingMode


class ShutEcu:
    """An `ecu.stepped.SteppedEcu` that reads no pressures and drives no jets. Raises ConfigError if only one of
    `bus.key` and `authentication` is given."""

    def __init__(self, config: Config, *, authentication: Authentication | None = None) -> None:
        self._messages, self._key = message_set(config.bus), key_of(authentication, config.bus)
        self._next_period = config.ecu.plan_ahead
        start = EcuState.power_on(window=1, sensors=SENSORS, horizon=1, delay=0)
        self.restore(start.authenticated(authentication, self._messages))

    @property
    def trace(self) -> Trace:
        mode = self.state.fail_safe.mode.on_wire
        return Trace(mode=mode, action=0.0, forces=None, interventions=Intervention.NOT_ENABLED)

    def restore(self, state: EcuState) -> None:
        """Continue from a state of an ECU without a release."""
        self.state = replace(state, fail_safe=_NO_RELEASE)

    def step(
        self, now_ns: int, frames: Sequence[Frame], health: BusHealth = HEALTHY, **around: Unpack[Surroundings]
    ) -> list[Frame]:
        """Do one control period as `ecu.ecu.Ecu.step` does. The ECU reports the missing release even during a fault."""
        before = self.state
        updating = around.get("updating", False) or before.fail_safe.mode is OperatingMode.UPDATE
        fail_safe = _UPDATING if updating else _NO_RELEASE
        self.state = replace(before.answered(self._messages), fail_safe=fail_safe, health=health)
        command = JetCommand(
            flow_m2_per_s=0.0, mode=self.trace.mode, enable=False, pressure_counter=None, next_period=self._next_period
        )
        return answers(before, command, self.state.status(bundle_hash=0), now_ns, self._messages, self._key)


_NO_RELEASE: Final = FailSafe(mode=OperatingMode.FAULT, reason=Reason.NO_RELEASE, enable_request=False)
_UPDATING: Final = FailSafe(mode=OperatingMode.UPDATE, reason=Reason.UPDATING, enable_request=False)
