"""The ECUs of a live session by their controllers: what a compiler makes is made once."""

from collections.abc import Callable

from contract.config.controller import CostWeights
from firmware_sim.ecu.ecu_state import EcuState
from firmware_sim.ecu.stepped import LoopEcu

MakeEcu = Callable[[str, CostWeights | None], LoopEcu]
"""(controller, weights of the cost, the release's if None) to an ECU just powered on; raises StillwakeError."""


class EcuShelf:
    """Keeps those whose weights can be changed.

    Args:
        make: what is not there yet.
        own: the release's weights.
    """

    def __init__(self, make: MakeEcu, own: CostWeights) -> None:
        self._make, self._own = make, own
        self._kept: dict[str, tuple[LoopEcu, EcuState]] = {}

    def ecu(self, controller: str, weights: CostWeights | None) -> LoopEcu:
        """One with these weights, in whatever state it is; it may be the one that runs.

        Raises:
            StillwakeError: if it cannot be had.
        """
        if controller not in self._kept:
            made = self._make(controller, weights)
            if made.weigh is None:
                return made
            self._kept[controller] = made, made.ecu.state
        ecu, _ = self._kept[controller]
        if ecu.weigh is not None:
            ecu.weigh(weights or self._own)
        return ecu

    def powered_on(self, controller: str, weights: CostWeights | None) -> LoopEcu:
        """The same, just powered on."""
        ecu = self.ecu(controller, weights)
        if controller in self._kept:
            ecu.ecu.restore(self._kept[controller][1])
        return ecu
