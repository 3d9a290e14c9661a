"""Everything of an ECU that a loss of power takes: made by booting, and made anew by each reset."""

from collections.abc import Callable
from functools import partial

from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Backing
from can_bridge.flashing.report import encode, report_of
from can_bridge.flashing.store import Store
from can_bridge.secoc.node import Authentication
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Nrc
from contract.config.tree import Config
from firmware_sim.ecu.flashable.calibration_link import CalibrationLink
from firmware_sim.ecu.flashable.diagnostic_link import DiagnosticLink
from firmware_sim.ecu.flashable.facts import facts
from firmware_sim.ecu.flashable.fitting import Fitting
from firmware_sim.ecu.flashable.inside import Inside, ToldProgramming
from firmware_sim.ecu.flashable.self_test import self_test
from firmware_sim.ecu.flashable.shut_ecu import ShutEcu
from firmware_sim.ecu.flashable.supplies import Supplies
from firmware_sim.ecu.flashable.telling import Access, tell_boot
from firmware_sim.ecu.flashable.vehicle_request import VehicleRequest
from firmware_sim.ecu.stepped import CalibratedEcu


class PowerCycle:
    """From one boot to the next reset.

    Args:
        request: of the vehicle, as last seen.
        now_ns: time of the service under way.
        on_reset: called when a tester's reset is due.

    Attributes:
        store, boot: as booted.
        ecu: the control at power-on; one without a release keeps the jets shut.
        calibration: None without a release.
        link: to the tester.

    Raises:
        ConfigError: `bus.key` without `authentication`, or the other way round.
    """

    def __init__(
        self,
        backing: Backing,
        config: Config,
        supplies: Supplies,
        authentication: Authentication | None,
        *,
        request: Callable[[], VehicleRequest],
        now_ns: Callable[[], int],
        on_reset: Callable[[], None],
    ) -> None:
        fitting = Fitting(config, supplies.controller_of)
        self.store = Store(backing, root=supplies.root, hardware=supplies.hardware, fits=fitting.fits)
        self.boot = self.store.boot()
        tell_boot(supplies.tell, self.boot)
        bundle = self.boot.bundle
        controller = None if bundle is None else fitting.controller(bundle)
        self.ecu: CalibratedEcu | ShutEcu
        self.calibration: CalibrationLink | None = None
        if bundle is None or controller is None:
            self.ecu = ShutEcu(config, authentication=authentication)
        else:
            self.ecu = ecu = supplies.ecu_of(bundle, controller, config, authentication)
            jets = lambda: Nrc.CONDITIONS_NOT_CORRECT if request().drives_jets else None  # noqa: E731
            self.calibration = CalibrationLink(bundle, ecu, self.store, config, supplies, refusal=jets)
        inside = Inside(
            facts(supplies, config),
            calibration=None if self.calibration is None else self.calibration.service,
            tests=None if bundle is None or controller is None else partial(self_test, bundle, controller),
            on_reset=on_reset,
            tell=supplies.tell,
        )
        self._programming = ToldProgramming(
            self.store,
            inside,
            refusal=lambda: request().refusal(now_ns()),
            report=lambda store: encode(report_of(store)),
            tell=supplies.tell,
        )
        self._server = UdsServer(self._programming, supplies.access, supplies.random_bytes)
        self.link = DiagnosticLink(config.bus, self._server)

    @property
    def is_updating(self) -> bool:
        """Whether a transfer was announced: only a reset leads out."""
        return self._programming.is_updating

    @property
    def access(self) -> Access:
        """Where the tester stands."""
        attempts = {level: self.store.failed_attempts(level) for level in Level}
        return Access(self._server.session, self._server.unlocked, attempts)
