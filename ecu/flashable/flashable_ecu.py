"""The ECU as a vehicle runs it: it boots a release from its store, controls, and can be flashed and calibrated.

`step` is a control period and one look at diagnosis, a function of time and received frames like
`ecu.ecu.Ecu.step`. Who has time between two periods calls `control` once a period and `service` in
between, as often as it likes; a thread of its own may do the latter. A reset loses what a loss of power would lose: the
release is booted again and every counter begins at 0, but freshness values, which no receiver would believe twice.
"""

from collections.abc import Sequence
from dataclasses import replace

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.flashing.backing import Backing
from can_bridge.flashing.boot import Boot
from can_bridge.flashing.store import Store
from can_bridge.secoc.node import Authentication
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import EcuStatus, Reason
from contract.config.tree import Config
from ecu.ecu_state import EcuState, Trace
from ecu.flashable.equipment import Equipment
from ecu.flashable.event_log import TesterAccess, log_access
from ecu.flashable.links import MOST_FRAMES
from ecu.flashable.power_cycle import PowerCycle
from ecu.flashable.watched_control import VehicleRequest
from ecu.shut_ecu import ShutEcu
from ecu.stepped import CalibratedEcu


class FlashableEcu:
    """A `ecu.stepped.SteppedEcu` with a store, just powered on. Raises ConfigError for `bus.key` without
    `authentication`, or the other way round.

    Args:
        backing: of the store.
        config: bus, E2E and fail-safe settings, operating point and control period of the vehicle.
        equipment: what it was given at production.
        authentication: with `bus.key`, what the ECU needs of it.
        boot_ns: for which it hears and sends nothing after a reset. In real time booting takes what it takes.
        serviced_apart: `step` is a control period alone; another thread calls `service`.

    Attributes:
        resets: since power-on.
    """

    def __init__(
        self,
        backing: Backing,
        config: Config,
        equipment: Equipment,
        *,
        authentication: Authentication | None = None,
        boot_ns: int = 0,
        serviced_apart: bool = False,
    ) -> None:
        self._backing, self._config, self._equipment = backing, config, equipment
        self._authentication, self._boot_ns, self._serviced_apart = authentication, boot_ns, serviced_apart
        self._heard, self._xcp_command = config.bus.diagnosis.heard, config.bus.diagnosis.xcp_command
        self._request = VehicleRequest()
        self._silent_until_ns: int | None = None
        self._service_ns = 0
        self._wants_reset = False
        self.resets = 0
        # The service works in a new cycle as soon as it is booted, the control from its next period on.
        self._serviced = self._controlled = self._power_on()

    @property
    def _ecu(self) -> CalibratedEcu | ShutEcu:
        return self._controlled.ecu

    @property
    def state(self) -> EcuState:
        """The state after the latest step."""
        return self._ecu.state

    @property
    def trace(self) -> Trace:
        """What the latest step did."""
        return self._ecu.trace

    @property
    def frames_rejected(self) -> int:
        """Pressure frames that came but were not accepted."""
        return self._ecu.frames_rejected

    @property
    def boot(self) -> Boot:
        """What the latest one came to."""
        return self._serviced.boot

    @property
    def store(self) -> Store:
        """The store as of the latest boot."""
        return self._serviced.store

    @property
    def access(self) -> TesterAccess:
        """Where the tester stands."""
        return self._serviced.access

    @property
    def is_busy(self) -> bool:
        """Whether `service` has something to do without another frame."""
        cycle = self._serviced
        is_sending = cycle.calibration is not None and cycle.calibration.is_sending
        return self._wants_reset or cycle.link.is_busy or is_sending

    @property
    def is_measuring(self) -> bool:
        """Whether `service` has something to send for each control period."""
        return self._serviced.calibration is not None and self._serviced.calibration.is_measuring

    @property
    def needs_reset(self) -> bool:
        """Whether only a reset leads out of the shut jets: a release is written, or a reset was asked for."""
        return self._wants_reset or self._serviced.is_updating

    def restore(self, state: EcuState) -> None:
        """Let the control go on from a state of an ECU with the same release and settings; the store stays."""
        self._ecu.restore(state)

    def status(self) -> EcuStatus:
        """Health counters as of the latest step."""
        return self._ecu.status()

    def step(self, now_ns: int, frames: Sequence[Frame], health: BusHealth = HEALTHY) -> list[Frame]:
        """One control period, and one call of `service` unless that is done apart. Returns a JetCommand and an
        EcuStatus, and what diagnosis sends. Nothing while it boots, and no command or status while a tester silenced
        them and no jet can run.

        Args:
            now_ns: time of the step, in the clock of the frames' timestamps.
            frames: everything received since the last step, oldest first.
            health: of the CAN controller, for the status.
        """
        if self._serviced_apart:
            return self.control(now_ns, frames, health)
        for_service = [frame for frame in frames if frame.identifier in self._heard]
        for_control = [frame for frame in frames if frame.identifier not in self._heard] if for_service else frames
        return self.control(now_ns, for_control, health) + self.service(now_ns, for_service)

    def control(self, now_ns: int, frames: Sequence[Frame], health: BusHealth = HEALTHY) -> list[Frame]:
        """One control period, without diagnosis; arguments as for `step`."""
        if self._is_silent(now_ns):
            return []
        self._take_over()
        if self._controlled.calibration is not None:
            self._controlled.calibration.hand_over()
        # What is booted next knows nothing of the jets that run now.
        fault = Reason.UPDATING if self._wants_reset else None
        before = self._ecu.state
        sent = self._ecu.step(now_ns, frames, health, fault=fault, updating=self._controlled.is_updating)
        after = self._ecu.state
        self._request = self._request.seen(before, after, now_ns)
        self._controlled.watch.seen(before, after, now_ns)
        if self._controlled.calibration is not None:
            self._controlled.calibration.sample(after)
        return [] if self._controlled.is_silent and not self._request.drives_jets else sent

    def service(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        """Diagnosis: take `MOST_FRAMES` or fewer, do at most one piece of long work, and return what is to be sent."""
        if self._is_silent(now_ns) or self._serviced is not self._controlled:
            return []
        if self._wants_reset:
            self._reset(now_ns)
            return []
        self._service_ns = now_ns
        cycle, frames = self._serviced, frames[:MOST_FRAMES]
        cycle.settle_faults()
        before = cycle.access
        sent = cycle.link.service(now_ns, [frame for frame in frames if frame.identifier != self._xcp_command])
        log_access(self._equipment.log, before, cycle.access)
        if cycle.calibration is not None:
            for_xcp = [frame for frame in frames if frame.identifier == self._xcp_command]
            sent += cycle.calibration.xcp(now_ns, for_xcp, room=cycle.link.room, may_store=not cycle.link.is_working)
        return sent

    # Between the two.

    def _power_on(self) -> PowerCycle:
        return PowerCycle(
            self._backing,
            self._config,
            self._equipment,
            self._authentication,
            request=lambda: self._request,
            now_ns=lambda: self._service_ns,
            on_reset=self._ask_for_reset,
        )

    def _is_silent(self, now_ns: int) -> bool:
        return self._silent_until_ns is not None and now_ns < self._silent_until_ns

    def _ask_for_reset(self) -> None:
        self._wants_reset = True

    def _reset(self, now_ns: int) -> None:
        self._serviced = self._power_on()
        self._silent_until_ns = now_ns + self._boot_ns
        self.resets += 1

    def _take_over(self) -> None:
        """Control by what was booted from now on: here and not where it was booted, which may be another thread."""
        cycle = self._serviced
        if cycle is self._controlled:
            return
        before = self._ecu.state
        cycle.ecu.restore(replace(cycle.ecu.state, verifier=before.verifier, freshness=before.freshness))
        self._request = VehicleRequest()
        self._wants_reset = False
        self._controlled = cycle
