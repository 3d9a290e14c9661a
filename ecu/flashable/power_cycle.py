"""The parts of an ECU that a power loss clears: a boot creates them, and each reset creates them again. Diagnosis gets
the vehicle's requests for control, and the faults, from the control periods."""

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, NamedTuple, Self, cast

import numpy as np

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.command_gate import Intervention
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Backing, MediumError
from can_bridge.flashing.state import TRIAL_BOOTS
from can_bridge.flashing.store import Boot, BootReason, Store
from can_bridge.secoc.node import Authentication, key_of
from can_bridge.uds.ecu_services import EcuServices
from can_bridge.uds.fault_codes import CODES
from can_bridge.uds.fault_memory import FaultMemory
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Nrc, Session
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import COUNT_LIMIT, SENSORS, EcuStatus, JetCommand, Reason
from contract.config.tree import Config
from contract.release.checks import Bundle
from ecu.ecu import Ecu
from ecu.ecu_state import EcuState, Trace, answers
from ecu.fail_safe import FailSafe, OperatingMode
from ecu.flashable.equipment import Equipment, Log, identification
from ecu.flashable.links import CalibrationLink, DiagnosticLink
from ecu.flashable.vehicle_fit import VehicleFit, self_test
from ecu.stepped import CalibratedEcu

NO_BUNDLE: Final = 0
"""Bundle hash that an ECU without a release sends in its status."""


class ShutEcu:
    """An `ecu.stepped.SteppedEcu` that reads no pressures and drives no jets. Raises ConfigError if only one of
    `bus.key` and `authentication` is given."""

    frames_rejected = 0

    def __init__(self, config: Config, *, authentication: Authentication | None = None) -> None:
        self._messages = message_set(config.bus)
        self._key = key_of(authentication, config.bus)
        self._next_period = config.ecu.plan_ahead
        start = EcuState.power_on(window=1, sensors=SENSORS, horizon=1, delay=0)
        self.restore(start.authenticated(authentication, self._messages))

    @property
    def state(self) -> EcuState:
        return self._state

    @property
    def trace(self) -> Trace:
        mode = self._state.fail_safe.mode.on_wire
        return Trace(mode=mode, action=0.0, forces=None, interventions=Intervention.NOT_ENABLED)

    def restore(self, state: EcuState) -> None:
        """Continue from a state of an ECU without a release."""
        self._state = replace(state, fail_safe=_NO_RELEASE)

    def step(
        self,
        now_ns: int,
        frames: Sequence[Frame],
        health: BusHealth = HEALTHY,
        *,
        fault: Reason | None = None,
        updating: bool = False,
    ) -> list[Frame]:
        """Do one control period as `ecu.ecu.Ecu.step` does. The ECU reports the missing release even during a fault."""
        before = self._state
        updating = updating or before.fail_safe.mode is OperatingMode.UPDATE
        fail_safe = _UPDATING if updating else _NO_RELEASE
        self._state = replace(before.answered(self._messages), fail_safe=fail_safe, health=health)
        command = JetCommand(
            flow_m2_per_s=0.0, mode=self.trace.mode, enable=False, pressure_counter=None, next_period=self._next_period
        )
        return answers(before, self._state, command, now_ns, self._messages, self._key, NO_BUNDLE)

    def status(self) -> EcuStatus:
        """Return the health counters after the latest step."""
        return self._state.status(NO_BUNDLE)


_NO_RELEASE: Final = FailSafe(mode=OperatingMode.FAULT, reason=Reason.NO_RELEASE, enable_request=False)
_UPDATING: Final = FailSafe(mode=OperatingMode.UPDATE, reason=Reason.UPDATING, enable_request=False)


REMEMBERED_NS: Final = 1_000_000_000
"""Time in ns for which the latest request for control counts, even if the bus is lost or a sensor fails meanwhile."""


@dataclass(frozen=True, kw_only=True)
class VehicleRequest:
    """The time in ns of the latest step with a request for control, or None, and whether the jets may run now."""

    asked_ns: int | None = None
    drives_jets: bool = False

    def seen(self, before: EcuState, after: EcuState, now_ns: int) -> Self:
        asks = after.missed == before.missed and after.fail_safe.enable_request
        return replace(self, asked_ns=now_ns if asks else self.asked_ns, drives_jets=after.fail_safe.mode.drives_jets)

    def refusal(self, now_ns: int) -> Nrc | None:
        """Return CONDITIONS_NOT_CORRECT while the jets may run and until `REMEMBERED_NS` after a request, else None."""
        asks = self.asked_ns is not None and now_ns - self.asked_ns < REMEMBERED_NS
        return Nrc.CONDITIONS_NOT_CORRECT if self.drives_jets or asks else None


_NUMBERS: Final = struct.Struct(">IBHH")
_MOST_MS: Final = 0xFFFF_FFFF


class FaultWatch:
    """A detector of faults in all control periods since power-on."""

    def __init__(self, memory: FaultMemory) -> None:
        self._memory = memory
        self._power_on_ns: int | None = None

    def seen(self, before: EcuState, after: EcuState, now_ns: int) -> None:
        is_first, now_ns = self._power_on_ns is None, max(0, now_ns)
        self._power_on_ns = now_ns if self._power_on_ns is None else self._power_on_ns
        was, now = before.fail_safe.mode, after.fail_safe.mode
        if now is was and not is_first:
            return
        if now is OperatingMode.CONTROL:
            self._memory.note(None)
        elif now is OperatingMode.FAULT and after.fail_safe.reason in CODES:
            self._memory.note(after.fail_safe.reason, _snapshot(before, after, now_ns - self._power_on_ns))


def _snapshot(before: EcuState, after: EcuState, since_power_on_ns: int) -> bytes:
    """Return the snapshot of the state in which a fault was found, with values in the order of `SNAPSHOT_FORMATS`."""
    return (
        _NUMBERS.pack(
            min(max(0, since_power_on_ns) // 1_000_000, _MOST_MS),
            before.fail_safe.mode.on_wire,
            min(after.missed, COUNT_LIMIT),
            min(after.overruns, COUNT_LIMIT),
        )
        + before.memory.window[-1, :SENSORS].astype(np.dtype(">f4")).tobytes()
    )


class TesterAccess(NamedTuple):
    """The session of a tester, its unlocked security level, and the number of consecutive wrong keys for each level."""

    session: Session
    unlocked: Level | None
    attempts: Mapping[Level, int]


def log_boot(log: Log, boot: Boot) -> None:
    verdicts = {f"slot_{slot.name.lower()}": verdict.in_words for slot, verdict in boot.verdicts.items()}
    if boot.bundle is None or boot.slot is None:
        log("no_release", "every release is damaged or missing: jets shut, waiting to be flashed", **verdicts)
        return
    name, digest = boot.bundle.name, boot.bundle.digest
    event, words = "booted", boot.reason.in_words
    if boot.reason is BootReason.TRIAL:
        event, words = "trial", f"on trial, boot {TRIAL_BOOTS - boot.boots_left} of {TRIAL_BOOTS} without confirmation"
    elif boot.reason is BootReason.REVERTED:
        event = "reverted"
    log(
        event,
        f"booted slot {boot.slot.name}: {name} {digest[:12]}, {words}",
        slot=boot.slot.name,
        release=name,
        digest=digest,
        boots_left=boot.boots_left,
        **verdicts,
    )


def log_access(log: Log, before: TesterAccess, after: TesterAccess) -> None:
    """Log the start or the end of a session, the unlocking of a security level, or the refusal of a key."""
    if after.session is not before.session:
        log("session", f"{after.session.name.lower()} session", session=after.session.name)
    if after.unlocked is not None and after.unlocked is not before.unlocked:
        log("unlocked", f"a tester unlocked {after.unlocked.name.lower()}", level=after.unlocked.name)
    for level, count in after.attempts.items():
        if count > before.attempts[level]:
            words = f"a tester's key for {level.name.lower()} was refused, {count} in a row"
            log("key_refused", words, level=level.name, count=count)


class PowerCycle:
    """The parts of an ECU from one boot to the next reset: the control and the links to the tester and the calibration
    tool. Without a release, the control keeps the jets shut, and there is no link to a calibration tool. Raises
    ConfigError if only one of `bus.key` and `authentication` is given.

    Args:
        request: returns the vehicle's latest request for control.
        now_ns: returns the time of the current call of the service, in ns.
        on_reset: called when the reset that a tester requested is due.
    """

    def __init__(
        self,
        backing: Backing,
        config: Config,
        equipment: Equipment,
        authentication: Authentication | None,
        *,
        request: Callable[[], VehicleRequest],
        now_ns: Callable[[], int],
        on_reset: Callable[[], None],
    ) -> None:
        fit = VehicleFit(config, equipment.controller_of)
        self.store = Store(backing, root=equipment.root, hardware=equipment.hardware, fits=fit.fits)
        self.boot = self.store.boot()
        log_boot(equipment.log, self.boot)
        # The cast is correct, because the check of this store returns objects of the type Bundle.
        bundle = cast("Bundle | None", self.boot.bundle)
        controller = None if bundle is None else fit.controller(bundle)
        jets = lambda: Nrc.CONDITIONS_NOT_CORRECT if request().drives_jets else None  # noqa: E731
        self.ecu: CalibratedEcu | ShutEcu
        self.calibration: CalibrationLink | None = None
        if bundle is None or controller is None:
            self.ecu = ShutEcu(config, authentication=authentication)
        else:
            self.ecu = ecu = Ecu(bundle, controller, config, authentication)
            self.calibration = CalibrationLink(bundle, ecu, self.store, config, equipment, refusal=jets)
        self._services = EcuServices(
            self.store,
            identification(equipment, config),
            calibration=None if self.calibration is None else self.calibration.service,
            self_test=None if bundle is None or controller is None else partial(self_test, bundle, controller),
            refusal=lambda: request().refusal(now_ns()),
            on_reset=on_reset,
            log=equipment.log,
        )
        self._log = equipment.log
        self._faults = FaultMemory(self.store.faults, keep=self.store.keep_faults, refusal=jets)
        self.watch = FaultWatch(self._faults)
        self._server = UdsServer(self._services, equipment.access, equipment.random_bytes, faults=self._faults)
        self.link = DiagnosticLink(config.bus, self._server)

    @property
    def is_updating(self) -> bool:
        """Whether a tester has announced a transfer since the boot. Then only a reset ends the update."""
        return self._services.is_updating

    @property
    def is_silent(self) -> bool:
        """Whether a tester has silenced the frames of the control. They are sent nevertheless while a jet can run."""
        return self._server.is_silent

    def settle_faults(self) -> None:
        """Add the faults that were found in control periods to the stored fault memory."""
        try:
            self._faults.settle()
        except MediumError as error:
            self._log("faults_not_kept", f"the fault memory was not stored: {error}")

    @property
    def access(self) -> TesterAccess:
        attempts = {level: self.store.state.failed_attempts[level] for level in Level}
        return TesterAccess(self._server.session, self._server.unlocked, attempts)
