"""The ECU in a vehicle: it boots a release from its store, controls the jets, and can be flashed and calibrated.

A caller calls `step` once a period, and `service` any number of times in between, possibly in another thread. A reset
has the effect of a power loss: the release is booted again and every counter begins at 0. Only freshness values and the
CAN controller's counts continue.
"""

from collections.abc import Sequence
from dataclasses import replace

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.flashing.backing import Backing
from can_bridge.secoc.securing import Authentication
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Reason
from contract.config.tree import Config
from ecu.ecu_state import EcuState, Trace
from ecu.flashable.equipment import Equipment
from ecu.flashable.links import MOST_FRAMES
from ecu.flashable.power_cycle import PowerCycle, log_access
from ecu.flashable.watched_control import VehicleRequest
from ecu.shut_ecu import ShutEcu
from ecu.stepped import CalibratedEcu


class FlashableEcu:
    """An `ecu.stepped.SteppedEcu` with a store; a new object has just been powered on. Raises ConfigError if only one
    of `bus.key` and `authentication` is given.

    Attributes:
        cycle: the parts that the latest boot created.
        resets: number of resets since power-on.
    """

    def __init__(
        self, backing: Backing, config: Config, equipment: Equipment, *, authentication: Authentication | None = None
    ) -> None:
        self._made_of, self._log = (backing, config, equipment, authentication), equipment.log
        self._xcp_command, self._request = config.bus.diagnosis.xcp_command, VehicleRequest()
        self._wants_reset = False
        self._service_ns = self.resets = 0
        # Diagnosis uses a new release as soon as it is booted; control uses it from the next period on.
        self.cycle = self._controlled = self._power_on()

    @property
    def _ecu(self) -> CalibratedEcu | ShutEcu:
        return self._controlled.ecu

    @property
    def state(self) -> EcuState:
        return self._ecu.state

    @property
    def trace(self) -> Trace:
        return self._ecu.trace

    @property
    def is_busy(self) -> bool:
        """Whether `service` has work to do even if it receives no further frame."""
        cycle = self.cycle
        is_sending = cycle.calibration is not None and cycle.calibration.is_sending
        return self._wants_reset or cycle.link.is_busy or is_sending

    @property
    def is_measuring(self) -> bool:
        """Whether `service` sends measured values for each control period."""
        return self.cycle.calibration is not None and self.cycle.calibration.is_measuring

    @property
    def needs_reset(self) -> bool:
        """Whether the jets stay shut until a reset, because a release was written or a reset was requested."""
        return self._wants_reset or self.cycle.is_updating

    def restore(self, state: EcuState) -> None:
        """Continue the control from a state of an ECU with the same release and settings; the store is not changed."""
        self._ecu.restore(state)

    def step(self, now_ns: int, frames: Sequence[Frame], health: BusHealth = HEALTHY) -> list[Frame]:
        """Run one control period, without diagnosis. Returns a JetCommand and an EcuStatus, unless a tester silenced
        them and no jet can run."""
        self._take_over()
        if self._controlled.calibration is not None:
            self._controlled.calibration.hand_over()
        # The jets are shut before the reset, because the release that boots next cannot find out whether they run.
        fault = Reason.UPDATING if self._wants_reset else None
        before, drove = self._ecu.state, self._request.drives_jets
        sent = self._ecu.step(now_ns, frames, health, fault=fault, updating=self._controlled.is_updating)
        after = self._ecu.state
        self._request = self._request.seen(before, after, now_ns)
        self._controlled.watch.seen(before, after, now_ns)
        if self._controlled.calibration is not None:
            self._controlled.calibration.sample(after)
        # The command that shuts the jets is sent, too, since the vehicle would otherwise follow the previous command.
        return [] if self._controlled.is_silent and not (drove or self._request.drives_jets) else sent

    def service(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        """Process up to `MOST_FRAMES` frames of diagnosis and a part of a long operation; return the frames to send."""
        if self.cycle is not self._controlled:
            return []
        if self._wants_reset:
            # If control began after the tester's request, the next control period shuts the jets first.
            if not self._request.drives_jets:
                self._reset()
            return []
        self._service_ns = now_ns
        cycle, frames = self.cycle, frames[:MOST_FRAMES]
        cycle.settle_faults()
        before = cycle.access
        sent = cycle.link.service(now_ns, [frame for frame in frames if frame.identifier != self._xcp_command])
        log_access(self._log, before, cycle.access)
        if cycle.calibration is not None:
            for_xcp = [frame for frame in frames if frame.identifier == self._xcp_command]
            sent += cycle.calibration.xcp(now_ns, for_xcp, room=cycle.link.room, may_store=not cycle.link.is_working)
        return sent

    # The following methods pass a reset and its new release from `service` to `step`.

    def _power_on(self) -> PowerCycle:
        return PowerCycle(
            *self._made_of, request=lambda: self._request, now_ns=lambda: self._service_ns, on_reset=self._ask_for_reset
        )

    def _ask_for_reset(self) -> None:
        self._wants_reset = True

    def _reset(self) -> None:
        self.cycle = self._power_on()
        self.resets += 1

    def _take_over(self) -> None:
        """Use the release that was booted last, perhaps in another thread, for control from now on."""
        if (cycle := self.cycle) is self._controlled:
            return
        before, booted = self._ecu.state, cycle.ecu.state
        speed = replace(booted.speed, verifier=before.speed.verifier)
        fresh = replace(booted, verifier=before.verifier, speed=speed, freshness=before.freshness)
        # This reset does not clear the CAN controller's counts: an earlier bus-off must not count as a new bus-off.
        cycle.ecu.restore(replace(fresh, health=before.health))
        self._request = VehicleRequest()
        self._wants_reset = False
        self._controlled = cycle
