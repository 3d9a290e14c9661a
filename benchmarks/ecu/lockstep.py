"""Two ECUs in one loop: the first one drives, the second one gets the same and must answer the same."""

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
"""Differences that are reported in full."""


class Lockstep:
    """Steps both, hands on the first one's answers, and counts where the second one answers or remembers another thing.

    Args:
        driver: whose frames go out.
        other: gets every call of the driver's.

    Attributes:
        steps, frames: compared so far.
        differing_frames: that were not the same in every byte, their times included, or that one of them did not send.
        differing_states: after which a number of the state was not the same to the bit.
        differences: the first ones, a line each.
    """

    def __init__(self, driver: CalibratedEcu, other: CalibratedEcu) -> None:
        self._driver, self._other = driver, other
        self.steps = self.frames = self.differing_frames = self.differing_states = 0
        self.differences: list[str] = []

    @property
    def state(self) -> EcuState:
        """The driver's."""
        return self._driver.state

    @property
    def trace(self) -> Trace:
        """The driver's."""
        return self._driver.trace

    @property
    def frames_rejected(self) -> int:
        """The driver's."""
        return self._driver.frames_rejected

    def status(self) -> EcuStatus:
        """The driver's."""
        return self._driver.status()

    @property
    def calibration(self) -> Calibration:
        """The driver's."""
        return self._driver.calibration

    def calibrate(self, calibration: Calibration) -> None:
        """Both."""
        self._driver.calibrate(calibration)
        self._other.calibrate(calibration)

    def restore(self, state: EcuState) -> None:
        """Both."""
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
        """One control period of both; the driver's frames."""
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
