"""The ECUs of a live session by their controllers: each is made once."""

from collections.abc import Callable

from contract.controller.calibration import Calibration
from firmware_sim.ecu.ecu_state import EcuState
from firmware_sim.ecu.stepped import LoopEcu

MakeEcu = Callable[[str], LoopEcu]
"""From a controller's name to its ECU, just powered on; raises StillwakeError."""


class EcuShelf:
    """Makes an ECU when it is first wanted, and keeps it.

    Args:
        make: makes one.
    """

    def __init__(self, make: MakeEcu) -> None:
        self._make = make
        self._kept: dict[str, tuple[LoopEcu, EcuState]] = {}

    def ecu(self, controller: str, calibration: Calibration) -> LoopEcu:
        """An ECU with these values, in whatever state it is; it may be the one that runs.

        Raises:
            StillwakeError: if it cannot be had.
        """
        if controller not in self._kept:
            made = self._make(controller)
            self._kept[controller] = made, made.ecu.state
        ecu, _ = self._kept[controller]
        ecu.ecu.calibrate(calibration)
        return ecu

    def powered_on(self, controller: str, calibration: Calibration) -> LoopEcu:
        """The same, just powered on."""
        ecu = self.ecu(controller, calibration)
        ecu.ecu.restore(self._kept[controller][1])
        return ecu
