"""The ECU as a vehicle runs it: it boots a release from its store, controls, and can be flashed and calibrated.

`step` is a control period and all diagnosis that fits into it, a function of time and received frames like
`firmware_sim.ecu.ecu.Ecu.step`. Who has time between two periods calls `control` once a period and `service` in between,
as often as it likes; the two may be called by two threads. A reset loses what a loss of power would lose: the release is
booted anew and every counter begins at 0, but freshness values, which no receiver would believe twice.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.flashing.backing import Backing
from can_bridge.flashing.boot import Boot
from can_bridge.flashing.store import Store
from can_bridge.secoc.node import Authentication
from can_bridge.uds.programming import Programming
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import REQUEST_ID, Level, Nrc, Session
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import EcuStatus, Reason
from contract.config.tree import Config
from contract.controller.interface import Controller
from contract.release.bundle import Bundle
from firmware_sim.ecu.ecu import Ecu, Trace
from firmware_sim.ecu.ecu_state import EcuState
from firmware_sim.ecu.flashable.calibration_link import CalibrationLink, is_for_xcp
from firmware_sim.ecu.flashable.diagnostic_link import DiagnosticLink
from firmware_sim.ecu.flashable.facts import facts
from firmware_sim.ecu.flashable.fitting import Fitting
from firmware_sim.ecu.flashable.node_diagnostics import Events, NodeDiagnostics
from firmware_sim.ecu.flashable.self_test import self_test
from firmware_sim.ecu.flashable.shut_ecu import ShutEcu
from firmware_sim.ecu.flashable.supplies import Supplies
from firmware_sim.ecu.flashable.telling import Access, tell_access, tell_boot
from firmware_sim.ecu.flashable.vehicle_wish import VehicleWish


class FlashableEcu:
    """A `firmware_sim.ecu.stepped.SteppedEcu` with a store, just powered on.

    Args:
        backing: of the store.
        config: bus, E2E and fail-safe settings, operating point and control period of the vehicle.
        supplies: what it was given at production.
        authentication: with `bus.key`, what the ECU needs of it.
        boot_ns: for which it hears and sends nothing after a reset. In real time booting takes what it takes.

    Attributes:
        resets: since power-on.

    Raises:
        ConfigError: `bus.key` without `authentication`, or the other way round.
    """

    def __init__(
        self,
        backing: Backing,
        config: Config,
        supplies: Supplies,
        *,
        authentication: Authentication | None = None,
        boot_ns: int = 0,
    ) -> None:
        self._backing, self._config, self._supplies = backing, config, supplies
        self._authentication, self._boot_ns = authentication, boot_ns
        self._wish = VehicleWish()
        self._silent_until_ns: int | None = None
        self._service_ns = 0
        self._is_updating = self._is_resetting = False
        self._booted: Ecu | ShutEcu | None = None
        self.resets = 0
        self._ecu = self._power_on()

    @property
    def state(self) -> EcuState:
        """After the latest step."""
        return self._ecu.state

    @property
    def trace(self) -> Trace:
        """Of the latest step."""
        return self._ecu.trace

    @property
    def frames_rejected(self) -> int:
        """Pressure frames that came but were not accepted."""
        return self._ecu.frames_rejected

    @property
    def boot(self) -> Boot:
        """What the latest one came to."""
        return self._boot

    @property
    def store(self) -> Store:
        """Since the latest boot."""
        return self._store

    @property
    def session(self) -> Session:
        """Of the diagnosis."""
        return self._server.session

    @property
    def is_busy(self) -> bool:
        """Whether `service` has something to do without another frame."""
        return self._is_resetting or self._link.is_busy

    def restore(self, state: EcuState) -> None:
        """Let the control go on from a state of an ECU with the same release and settings; the store stays."""
        self._ecu.restore(state)

    def status(self) -> EcuStatus:
        """Health counters as of the latest step."""
        return self._ecu.status()

    def step(
        self,
        now_ns: int,
        frames: Sequence[Frame],
        health: BusHealth = HEALTHY,
        *,
        fault: Reason | None = None,
    ) -> list[Frame]:
        """One control period, and one call of `service`.

        Args:
            now_ns: time of the step, in the clock of the frames' timestamps.
            frames: everything received since the last step, oldest first.
            health: of the CAN controller, for the status.
            fault: for which the ECU must switch itself off, found by what is around it.

        Returns:
            A JetCommand and an EcuStatus, and what diagnosis sends. Nothing while it boots.
        """
        for_control = [frame for frame in frames if not is_diagnostic(frame)]
        for_service = [frame for frame in frames if is_diagnostic(frame)] if len(for_control) < len(frames) else []
        sent = self.control(now_ns, for_control, health, fault=fault)
        return sent + self.service(now_ns, for_service)

    def control(
        self,
        now_ns: int,
        frames: Sequence[Frame],
        health: BusHealth = HEALTHY,
        *,
        fault: Reason | None = None,
    ) -> list[Frame]:
        """One control period, without diagnosis."""
        if self._silent_until_ns is not None and now_ns < self._silent_until_ns:
            return []
        self._take_over()
        if self._is_resetting:
            fault = Reason.NO_RELEASE
        self._calibrate()
        before = self._ecu.state
        sent = self._ecu.step(now_ns, frames, health, fault=fault, updating=self._is_updating)
        self._wish = self._wish.seen(before, self._ecu.state, now_ns)
        return sent

    def service(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        """Diagnosis: take frames, do at most one piece of long work, and return what is to be sent now."""
        if self._silent_until_ns is not None and now_ns < self._silent_until_ns:
            return []
        self._service_ns = now_ns
        if self._is_resetting:
            if self._booted is None:
                self._reset(now_ns)
            return []
        before = self._access()
        sent = self._link.service(now_ns, [frame for frame in frames if not is_for_xcp(frame)])
        tell_access(self._supplies.tell, before, self._access())
        if self._calibration is not None:
            sent += self._calibration.xcp(now_ns, [frame for frame in frames if is_for_xcp(frame)])
        return sent

    # Reset.

    def _power_on(self) -> Ecu | ShutEcu:
        """Everything volatile anew; the control is returned, and stepped from the next period on."""
        fitting = Fitting(self._config, self._supplies.controller_of)
        supplies = self._supplies
        self._store = Store(
            self._backing, root=supplies.root, hardware=supplies.hardware, fits=fitting.fits
        )
        self._boot = self._store.boot()
        tell_boot(supplies.tell, self._boot)
        bundle = self._boot.bundle
        controller = None if bundle is None else fitting.controller(bundle)
        self._calibration = None
        if bundle is not None:
            self._calibration = CalibrationLink(
                bundle, self._store, self._config, supplies, refusal=self._jets_may_run
            )
        diagnostics = NodeDiagnostics(
            Programming(self._store, refusal=lambda: self._wish.refusal(self._service_ns)),
            facts=facts(supplies, self._config),
            calibration=None if self._calibration is None else self._calibration.service,
            self_test=None if bundle is None or controller is None else partial(self_test, bundle, controller),
            events=Events(erased=self._begin_update, reset=self._ask_for_reset, tell=supplies.tell),
        )
        self._server = UdsServer(diagnostics, supplies.access, supplies.random_bytes)
        self._link = DiagnosticLink(self._config.bus, self._server)
        return self._controlled(bundle, controller)

    def _controlled(self, bundle: Bundle | None, controller: Controller | None) -> Ecu | ShutEcu:
        if bundle is None or controller is None:
            return ShutEcu(self._config, authentication=self._authentication)
        return Ecu(bundle, controller, self._config, authentication=self._authentication)

    def _jets_may_run(self) -> Nrc | None:
        return Nrc.CONDITIONS_NOT_CORRECT if self._wish.drives_jets else None

    def _access(self) -> Access:
        server = self._server
        return Access(server.session, server.unlocked, {level: self._store.failed_attempts(level) for level in Level})

    def _begin_update(self) -> None:
        self._is_updating = True

    def _ask_for_reset(self) -> None:
        self._is_resetting = True

    def _reset(self, now_ns: int) -> None:
        self._booted = self._power_on()
        self._silent_until_ns = now_ns + self._boot_ns
        self.resets += 1

    def _calibrate(self) -> None:
        """Other values from this period on."""
        calibration = self._calibration
        if calibration is None or not isinstance(self._ecu, Ecu) or (values := calibration.take()) is None:
            return
        self._ecu = self._ecu.calibrated(values)

    def _take_over(self) -> None:
        """Step what was booted from now on. Here and not where it was booted: that may be another thread."""
        if (booted := self._booted) is None:
            return
        self._booted = None
        before = self._ecu.state
        booted.restore(replace(booted.state, verifier=before.verifier, freshness=before.freshness))
        self._ecu, self._wish = booted, VehicleWish()
        self._is_updating = self._is_resetting = False


def is_diagnostic(frame: Frame) -> bool:
    """Whether a received frame is for diagnosis or calibration."""
    return (frame.frame_id == REQUEST_ID and not frame.is_extended) or is_for_xcp(frame)
