"""The state of an ECU as one value. An equal ECU continues from this value with the same results, bit for bit."""

from dataclasses import dataclass, field, replace
from typing import Any, Self, TypedDict

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.command_gate import Intervention
from can_bridge.e2e.profiles import SenderState, protected_frame
from can_bridge.e2e.receiver import FrameCheck, ReceiverState
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import Authentication, Freshness, VerifierState, secured
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import Message, MessageSet
from can_bridge.wire.messages import BUS_OFF_LIMIT, COUNT_LIMIT, ERROR_LIMIT, EcuStatus, JetCommand, Mode, Reason
from contract.arrays import Array
from ecu.benefit_check import BenefitCheckState
from ecu.controller_memory import ControllerMemory
from ecu.fail_safe import FailSafe
from ecu.pressure_reception import OtherEcu
from ecu.sensor_check import SensorCheckState
from ecu.speed_reception import SpeedState
from ecu.timing import StepTiming


class Surroundings(TypedDict, total=False):
    """The external conditions of an ECU in a control period: a `fault` for which the ECU must switch itself off, and
    `updating`, whether a release is being written. If so, the ECU is off until a reset as soon as no jet may run."""

    fault: Reason | None
    updating: bool


@dataclass(frozen=True, kw_only=True)
class EcuState:
    """The state after a control period; times are on the clock of frame timestamps.

    Attributes:
        pressures, verifier: states of the Pressure message's receiver and authentication.
        pressure_ns: sampling time of the latest usable pressures, in ns; None before the first.
        pressure_counter: counter of the frame with these pressures; None before the first.
        overruns: number of whole control periods skipped since power-on.
        missed: number of steps without usable pressures since power-on.
        speed: state of the reception of the vehicle's speed; as at power-on if the release does not need the speed.
        freshness: freshness values for the next JetCommand and the next EcuStatus.
    """

    memory: ControllerMemory
    fail_safe: FailSafe
    pressures: ReceiverState = field(default_factory=ReceiverState)
    commands: SenderState = field(default_factory=SenderState)
    statuses: SenderState = field(default_factory=SenderState)
    timing: StepTiming = field(default_factory=StepTiming)
    pressure_ns: int | None = None
    pressure_counter: int | None = None
    overruns: int = 0
    missed: int = 0
    sensors: SensorCheckState
    benefit: BenefitCheckState = field(default_factory=BenefitCheckState)
    speed: SpeedState = field(default_factory=SpeedState)
    health: BusHealth = HEALTHY
    other_ecu: OtherEcu = field(default_factory=OtherEcu)
    verifier: VerifierState = field(default_factory=VerifierState)
    freshness: Freshness = field(default_factory=Freshness)

    @classmethod
    def power_on(
        cls, *, window: int, sensors: int, horizon: int, delay: int, past: int = 0, speed: SpeedState | None = None
    ) -> Self:
        """Return the state before any frame was received or sent; `ControllerMemory.empty` explains the sizes."""
        return cls(
            memory=ControllerMemory.empty(length=window, sensors=sensors, horizon=horizon, delay=delay, past=past),
            fail_safe=FailSafe(),
            sensors=SensorCheckState.start(window=past or window, sensors=sensors),
            speed=SpeedState() if speed is None else speed,
        )

    def authenticated(self, authentication: Authentication | None, messages: MessageSet) -> Self:
        """Return the power-on state with the data for authentication; without a key, return the state unchanged."""
        if authentication is None:
            return self
        speed = replace(self.speed, verifier=authentication.verifier(messages.speed.spec))
        verifier = authentication.verifier(messages.pressure.spec)
        return replace(self, verifier=verifier, speed=speed, freshness=authentication.freshness)

    def answered(self, messages: MessageSet) -> Self:
        """Return the state after the two frames of a period were sent: the next counters and freshness values."""
        commands, statuses = self.commands.next(messages.command.spec), self.statuses.next(messages.status.spec)
        return replace(self, commands=commands, statuses=statuses, freshness=self.freshness.next())

    @property
    def frames_rejected(self) -> int:
        """The number of pressure frames that were not authentic or failed their end-to-end check."""
        return self.verifier.refused + self.pressures.frames_rejected

    def status(self, bundle_hash: int) -> EcuStatus:
        """Return the status message of an ECU that runs this bundle."""
        return EcuStatus(
            state=self.fail_safe.mode.on_wire,
            reason=self.fail_safe.reason,
            overruns=min(self.overruns, COUNT_LIMIT),
            missed=min(self.missed, COUNT_LIMIT),
            crc_errors=min(self.pressures.count(FrameCheck.ERROR), COUNT_LIMIT),
            refused=min(sum(map(self.pressures.count, (FrameCheck.REPEATED, FrameCheck.WRONG_SEQUENCE))), COUNT_LIMIT),
            not_authentic=min(self.verifier.refused, COUNT_LIMIT),
            bus_off=min(self.health.bus_off, BUS_OFF_LIMIT),
            tx_errors=min(self.health.tx_errors, ERROR_LIMIT),
            rx_errors=min(self.health.rx_errors, ERROR_LIMIT),
            bundle_hash=bundle_hash,
            set_aside=self.sensors.mask,
        )


def answers(
    before: EcuState, command: JetCommand, status: EcuStatus, now_ns: int, messages: MessageSet, key: Key | None
) -> list[Frame]:
    """Return a period's two frames, with the counters and freshness values of the state `before` the period."""

    def frame(sender: SenderState, message: Message[Any], content: JetCommand | EcuStatus) -> Frame:
        # A frame's time must not be negative. If the clock gives a negative time, the jets are shut anyway.
        protected = protected_frame(sender, message.emit(content), spec=message.spec, now_ns=max(0, now_ns))
        return secured(protected, spec=message.spec, key=key, freshness=before.freshness)

    return [frame(before.commands, messages.command, command), frame(before.statuses, messages.status, status)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """The results of the latest step, for observers. `action` is the sent action in U_inf W. `forces` are the predicted
    (Cd, Cl) over the H steps of the horizon, (H, 2), in units of the design speed; None without a plan."""

    mode: Mode
    action: float
    forces: Array | None
    interventions: Intervention
