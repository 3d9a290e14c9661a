"""The parts of an ECU that a power loss clears: a boot creates them, and each reset creates them again."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple, cast

from can_bridge.flashing.backing import Backing, MediumError
from can_bridge.flashing.state import TRIAL_BOOTS, Level
from can_bridge.flashing.store import Boot, BootReason, Store
from can_bridge.secoc.securing import Authentication
from can_bridge.uds.ecu_services import EcuServices
from can_bridge.uds.fault_memory import FaultMemory
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Nrc, Session
from contract.config.tree import Config
from contract.release.checks import Bundle
from ecu.ecu import Ecu
from ecu.flashable.equipment import Equipment, Log, identification
from ecu.flashable.links import CalibrationLink, DiagnosticLink
from ecu.flashable.vehicle_fit import VehicleFit, self_test
from ecu.flashable.watched_control import FaultWatch, VehicleRequest
from ecu.shut_ecu import ShutEcu
from ecu.stepped import CalibratedEcu


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
