"""The control of an ECU that can be flashed, for a loop that leaves the diagnosis to another thread."""

from collections.abc import Sequence

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Reason
from firmware_sim.ecu.ecu import Trace
from firmware_sim.ecu.ecu_state import EcuState
from firmware_sim.ecu.flashable.flashable_ecu import FlashableEcu


class ControlSide:
    """A `firmware_sim.ecu.daemon.control_loop.SteppedInTime`."""

    def __init__(self, ecu: FlashableEcu) -> None:
        self._ecu = ecu

    @property
    def state(self) -> EcuState:
        """After the latest step."""
        return self._ecu.state

    @property
    def trace(self) -> Trace:
        """Of the latest step."""
        return self._ecu.trace

    def restore(self, state: EcuState) -> None:
        """Go on from a state."""
        self._ecu.restore(state)

    def step(
        self, now_ns: int, frames: Sequence[Frame], health: BusHealth = HEALTHY, *, fault: Reason | None = None
    ) -> list[Frame]:
        """One control period."""
        return self._ecu.control(now_ns, frames, health, fault=fault)
