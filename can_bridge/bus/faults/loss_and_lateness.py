"""Frames that do not arrive, one by one or in bursts, that arrive more than once, late, or in another order.

The last two act on what a node receives: it is who asks for frames.
"""

import heapq
from dataclasses import dataclass, replace
from random import Random
from typing import Annotated, Any

from can_bridge.bus.faults.fault import NS, Change, FrameFault, Injector, Probability, SidedFault
from can_bridge.wire.frame import Frame
from contract.config.rules import AtLeastOne, Fraction, NonNegative, at_least, require


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


class _Delaying(Injector["Delay"]):
    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._waiting: list[tuple[int, int, Frame]] = []  # due time, serial number
        self._serial = 0
        self._last_due_ns = 0

    def receive_all(self) -> list[Frame]:
        """What is due, in the order of the times at which it became so."""
        now_ns = self._clock()
        for arrived_ns, frame in self._arrivals.of(self._bus.receive_all(), now_ns):
            due_ns = arrived_ns
            if self._fault.concerns(frame):
                if self._fault.is_active(arrived_ns):
                    due_ns += round((self._fault.delay_s + self._random.random() * self._fault.jitter_s) * NS)
                # A queue: no frame overtakes another, the frames after the fault's end included.
                due_ns = self._last_due_ns = max(due_ns, self._last_due_ns)
            self.acted += due_ns > arrived_ns
            self._serial += 1
            stamp_ns = frame.timestamp_ns + (due_ns - arrived_ns if self._fault.restamp else 0)
            heapq.heappush(self._waiting, (due_ns, self._serial, replace(frame, timestamp_ns=stamp_ns)))
        due: list[Frame] = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            due.append(heapq.heappop(self._waiting)[2])
        return due


@dataclass(frozen=True, kw_only=True)
class Delay(FrameFault, section="delay"):
    """Frames wait in a queue, in their order, and are received once their time has come. `acted` counts the late.

    The delay counts from the arrival (`can_bridge.bus.faults.fault.Arrivals`).
    """

    injector = _Delaying

    delay_s: NonNegative[float]
    """At least."""
    jitter_s: NonNegative[float] = 0.0
    """At most so much more, uniformly distributed."""
    restamp: bool = True
    """The frame waits ahead of where its time stamp is made, as in a gateway, so that the stamp is late, too.
    Otherwise it waits behind it, in a queue of the receiver, and the stamp shows it."""


class _Reordering(Injector["Reorder"]):
    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._kept: list[Frame] = []

    def receive_all(self) -> list[Frame]:
        """Whole windows, shuffled; frames that the fault does not concern at once."""
        now_ns = self._clock()
        frames: list[Frame] = []
        for arrived_ns, frame in self._arrivals.of(self._bus.receive_all(), now_ns):
            if not self._fault.concerns(frame):
                frames.append(frame)
            elif not self._fault.is_active(arrived_ns):
                frames += [*self._shuffled(), frame]
            else:
                self._kept.append(frame)
                if len(self._kept) == self._fault.window:
                    frames += self._shuffled()
        return frames if self._fault.is_active(now_ns) else [*frames, *self._shuffled()]

    def _shuffled(self) -> list[Frame]:
        kept, self._kept = self._kept, []
        order = list(range(len(kept)))
        self._random.shuffle(order)
        self.acted += sum(place != index for place, index in enumerate(order))
        return [kept[index] for index in order]


@dataclass(frozen=True, kw_only=True)
class Reorder(FrameFault, section="reorder"):
    """So many frames are kept and then received together in a random order. `acted` counts those out of place.

    No frame moves by `window` places or more. What is kept when the span ends is received at the next look.
    """

    injector = _Reordering

    window: Annotated[int, at_least(1)] = 2
