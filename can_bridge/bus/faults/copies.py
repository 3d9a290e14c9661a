"""Frames that arrive more than once."""

from dataclasses import dataclass
from random import Random

from can_bridge.bus.faults.fault import Probability
from can_bridge.bus.faults.frame_by_frame import Change, SidedFault
from contract.config.rules import AtLeastOne


@dataclass(frozen=True, kw_only=True)
class Duplicate(SidedFault, section="duplicate"):
    """Copies follow a frame directly, time stamp included. `acted` counts the frames that were copied.

    On CAN itself: a sender that sees an error in the last bit of the end of frame repeats what the receivers, which
    accepted it one bit earlier, have already (ISO 11898-1, message validation).
    """

    probability: Probability[float] = 1.0
    copies: AtLeastOne[int] = 1
    """Copies of each frame, without the frame itself."""

    def change(self, random: Random) -> Change:
        """See `SidedFault.change`."""
        return lambda frame: [frame] * (1 + self.copies) if random.random() < self.probability else [frame]
