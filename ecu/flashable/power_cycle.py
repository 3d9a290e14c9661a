"""The parts of an ECU that a power loss clears: a boot creates them, and each reset creates them again."""

from collections.abc import Callable
from functools import partial
from typing import cast

from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Backing, MediumError
from can_bridge.flashing.store import Store
from can_bridge.secoc.node import Authentication
from can_bridge.uds.ecu_services import EcuServices
from can_bridge.uds.fault_memory import FaultMemory
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Nrc
from contract.config.tree import Config
from contract.release.checks import Bundle
from ecu.flashable.equipment import Equipment, identification
from ecu.flashable.event_log import TesterAccess, log_boot
from ecu.flashable.links import CalibrationLink, DiagnosticLink
from ecu.flashable.vehicle_fit import VehicleFit, self_test
from ecu.flashable.watched_control import FaultWatch, VehicleRequest
from ecu.shut_ecu import ShutEcu
from ecu.stepped import CalibratedEcu


class PowerCycle:
    """The parts of an ECU from one boot to the next reset. Raises ConfigError if only one of `bus.key` and
    `authentication` is given.

    Args:
        request: returns the vehicle's latest request for control.
        now_ns: returns the time of the current call of the service, in ns.
        on_reset: called when the reset that a tester requested is due.

    Attributes:
        store, boot: the store and the result of its boot.
        ecu: the control, just powered on; without a release, an ECU that keeps the jets shut.
        calibration: link to a calibration tool; None without a release.
        link: link to the tester.
        watch: detector of faults in the control periods.
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
        # The cast is correct, because the check that this store was given returns objects of the type Bundle.
        bundle = cast("Bundle | None", self.boot.bundle)
        controller = None if bundle is None else fit.controller(bundle)
        jets = lambda: Nrc.CONDITIONS_NOT_CORRECT if request().drives_jets else None  # noqa: E731
        self.ecu: CalibratedEcu | ShutEcu
        self.calibration: CalibrationLink | None = None
        if bundle is None or controller is None:
            self.ecu = ShutEcu(config, authentication=authentication)
        else:
            self.ecu = ecu = equipment.ecu_of(bundle, controller, config, authentication)
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
        """Write the faults that were found in the control periods into the stored fault memory."""
        try:
            self._faults.settle()
        except MediumError as error:
            self._log("faults_not_kept", f"the fault memory was not stored: {error}")

    @property
    def access(self) -> TesterAccess:
        """The session, the unlocked security level and the wrong keys of the tester."""
        attempts = {level: self.store.state.failed_attempts[level] for level in Level}
        return TesterAccess(self._server.session, self._server.unlocked, attempts)
