"""The interface through which a closed loop uses an ECU in Python, in C, or on an emulated core."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, Unpack

from can_bridge.bus.interface import BusHealth
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import EcuStatus
from contract.controller.calibration import Calibration
from ecu.ecu_state import EcuState, Surroundings, Trace


class SteppedEcu(Protocol):
    """An ECU with the same methods as `ecu.ecu.Ecu`, which documents them."""

    @property
    def state(self) -> EcuState: ...

    @property
    def trace(self) -> Trace: ...

    def restore(self, state: EcuState) -> None: ...

    def step(self, now_ns: int, frames: Sequence[Frame], health: BusHealth = ...) -> list[Frame]: ...


class CalibratedEcu(SteppedEcu, Protocol):
    """An ECU that runs a release, and whose cost weights and bounds can be changed between two steps."""

    @property
    def calibration(self) -> Calibration: ...

    def calibrate(self, calibration: Calibration) -> None: ...

    def status(self) -> EcuStatus: ...

    def step(
        self, now_ns: int, frames: Sequence[Frame], health: BusHealth = ..., **around: Unpack[Surroundings]
    ) -> list[Frame]: ...


@dataclass(frozen=True, kw_only=True)
class LoopEcu:
    """An ECU for a closed loop, and the data about the ECU that a run records.

    Attributes:
        kind: python, c or mcu.
        computed_by: description of the code that computes the control step, in words.
        step_ns: returns the duration in ns of the latest step, in virtual time; None means `ecu.compute_time_ms`.
        clock_mhz: clock frequency in MHz of the core to which `step_ns` refers.
        start_clock: sets an emulated core's clock to 0, the start of a run; other ECUs have no clock of their own.
    """

    ecu: CalibratedEcu
    kind: str
    computed_by: str
    step_ns: Callable[[], int] | None = None
    clock_mhz: float | None = None
    start_clock: Callable[[], None] = lambda: None
