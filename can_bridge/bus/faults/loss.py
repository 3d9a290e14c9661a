"""Frames that do not arrive, one by one or in bursts, and frames that arrive more than once."""

from dataclasses import dataclass
from random import Random
from typing import Annotated

from can_bridge.bus.faults.fault import Probability
from can_bridge.bus.faults.frame_by_frame import Change, SidedFault
from can_bridge.wire.frame import Frame
from contract.config.rules import AtLeastOne, Fraction, at_least, require


@dataclass(frozen=True, kw_only=True)
class Drop(SidedFault, section="drop"):
    """Each frame is lost with the same probability, whatever became of the others. `acted` counts the lost."""

    probability: Probability[float]

    def change(self, random: Random) -> Change:
        """See `SidedFault.change`."""
        return lambda frame: [] if random.random() < self.probability else [frame]


@dataclass(frozen=True, kw_only=True)
class BurstLoss(SidedFault, section="burst_loss"):
    """Frames are lost in bursts of geometrically distributed length. `acted` counts the lost.

    A Markov chain of two states, good and bad; a frame in the bad state is lost, one in the good state is not (Gilbert,
    "Capacity of a burst-noise channel", Bell System Technical Journal 39 (1960), with Elliott's (1963) error
    probabilities of 0 and 1). The chain moves on with each frame and begins in its stationary distribution.
    """

    loss: Fraction[float]
    """Share of the frames that are lost in the long run."""
    mean_burst: Annotated[float, at_least(1)]
    """Mean number of frames lost in a row."""

    def __post_init__(self) -> None:
        super().__post_init__()
        most = self.mean_burst / (self.mean_burst + 1.0)
        wording = f"at most {most:g} with bursts of {self.mean_burst:g}: one frame at least passes between two"
        require(self.loss <= most, self, "loss", wording)

    @property
    def to_good(self) -> float:
        """Probability that a lost frame is the last one of its burst."""
        return 1.0 / self.mean_burst

    @property
    def to_bad(self) -> float:
        """Probability that a burst begins behind a frame that passed."""
        return self.to_good * self.loss / (1.0 - self.loss)

    def change(self, random: Random) -> Change:
        """See `SidedFault.change`."""
        # A frame before the first was lost with the share of the lost: the stationary distribution, which stays.
        bad = random.random() < self.loss

        def change(frame: Frame) -> list[Frame]:
            nonlocal bad
            bad = random.random() < (1.0 - self.to_good if bad else self.to_bad)
            return [] if bad else [frame]

        return change


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
