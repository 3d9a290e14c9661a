"""What a closed loop needs of an ECU, whatever computes it: the one in Python, the one in C, an emulated core."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, Unpack

from can_bridge.bus.interface import BusHealth
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import EcuStatus
from contract.controller.calibration import Calibration
from ecu.ecu_state import EcuState, Surroundings, Trace


class SteppedEcu(Protocol):
    """`ecu.ecu.Ecu` is one; its methods document these."""

    @property
    def state(self) -> EcuState:
        """The state after the latest step."""

    @property
    def trace(self) -> Trace:
        """Trace of the latest step."""

    @property
    def frames_rejected(self) -> int:
        """Pressure frames that came but were not accepted."""

    def restore(self, state: EcuState) -> None:
        """Go on from a state."""

    def step(self, now_ns: int, frames: Sequence[Frame], health: BusHealth = ...) -> list[Frame]:
        """One control period: the frames to be sent."""

    def status(self) -> EcuStatus:
        """Health counters as of the latest step."""


class CalibratedEcu(SteppedEcu, Protocol):
    """One that runs a release, and whose goal and bounds can be changed between two steps."""

    @property
    def calibration(self) -> Calibration:
        """The values in force."""

    def calibrate(self, calibration: Calibration) -> None:
        """Have other values from the next step on; raises ConfigError."""

    def step(
        self, now_ns: int, frames: Sequence[Frame], health: BusHealth = ..., **around: Unpack[Surroundings]
    ) -> list[Frame]:
        """The same, with what is around the ECU."""


@dataclass(frozen=True, kw_only=True)
class LoopEcu:
    """An ECU for a closed loop, and what a run records of it.

    Attributes:
        kind: python, c or mcu.
        computed_by: what computes its control step, for people.
        step_ns: what its latest step takes in virtual time; the loop charges `ecu.compute_time_ms` without it.
        clock_mhz: of the core that `step_ns` is of.
    """

    ecu: CalibratedEcu
    kind: str
    computed_by: str
    step_ns: Callable[[], int] | None = None
    clock_mhz: float | None = None
