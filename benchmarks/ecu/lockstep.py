"""Two ECUs in one loop: the first controls the loop; the second gets the same inputs and must give the same outputs."""

from collections.abc import Sequence
from typing import Final

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import EcuStatus, Reason
from contract.controller.calibration import Calibration
from ecu.ecu_state import EcuState, Trace
from ecu.in_c.c_structs import differing
from ecu.stepped import CalibratedEcu

KEPT: Final = 10
"""Largest number of differences that are reported in full."""


class Lockstep:
    """A pair of ECUs with the interface of a single ECU. It steps both ECUs, returns the frames of `driver`, and counts
    the differences between the two ECUs' frames and states.

    Args:
        driver: ECU whose frames are sent.
        other: ECU that gets every call that the driver gets.

    Attributes:
        steps, frames: numbers of steps and frames compared so far.
        differing_frames: number of frames that differed in a byte or in time, or that only one ECU sent.
        differing_states: number of steps after which the states differed in a bit.
        differences: descriptions of the first differences, one line each.
    """

    def __init__(self, driver: CalibratedEcu, other: CalibratedEcu) -> None:
        self._driver, self._other = driver, other
        self.steps = self.frames = self.differing_frames = self.differing_states = 0
        self.differences: list[str] = []

    @property
    def state(self) -> EcuState:
        """State of the driver."""
        return self._driver.state

    @property
    def trace(self) -> Trace:
        """Trace of the driver."""
        return self._driver.trace

    @property
    def frames_rejected(self) -> int:
        """Number of frames that the driver rejected."""
        return self._driver.frames_rejected

    def status(self) -> EcuStatus:
        """Return the driver's status."""
        return self._driver.status()

    @property
    def calibration(self) -> Calibration:
        """Calibration of the driver."""
        return self._driver.calibration

    def calibrate(self, calibration: Calibration) -> None:
        """Set this calibration in both ECUs."""
        self._driver.calibrate(calibration)
        self._other.calibrate(calibration)

    def restore(self, state: EcuState) -> None:
        """Set this state in both ECUs."""
        self._driver.restore(state)
        self._other.restore(state)

    def step(
        self,
        now_ns: int,
        frames: Sequence[Frame],
        health: BusHealth = HEALTHY,
        *,
        fault: Reason | None = None,
        updating: bool = False,
    ) -> list[Frame]:
        """Step both ECUs for one control period; return the driver's frames."""
        sent, expected = (
            ecu.step(now_ns, frames, health, fault=fault, updating=updating) for ecu in (self._driver, self._other)
        )
        self.steps += 1
        self.frames += max(len(sent), len(expected))
        same = sum(one == other for one, other in zip(sent, expected, strict=False))
        differs = max(len(sent), len(expected)) - same
        fields = differing(self._driver.state, self._other.state)
        self.differing_frames += differs
        self.differing_states += bool(fields)
        if (differs or fields) and len(self.differences) < KEPT:
            self.differences.append(
                f"step {self.steps} at {now_ns} ns: {differs} frames, state: {', '.join(fields) or 'same'}"
            )
        return sent
