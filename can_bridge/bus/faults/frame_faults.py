"""The faults of single frames: lost, duplicated, late, out of order, with changed data, or with wrong bits on the bus.

CAN's own CRC does not detect data that were changed before they reached the sender's CAN controller, or after they left
the receiver's controller. The CRC detects wrong bits on the bus; the sender then repeats the frame.
"""

import heapq
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count
from math import log1p
from random import Random
from typing import Annotated, Final

from can_bridge.bus.faults.fault import NS, Change, FrameFault, Injector, Probability, Receive, Send, SidedFault, Span
from can_bridge.e2e.profiles import profile_of
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import sent_bits
from can_bridge.wire.message_specs import SPECS, MessageSpec
from contract.config.rules import AtLeastOne, Fraction, NonNegative, at_least, require
from contract.errors import BusError


@dataclass(frozen=True, kw_only=True)
class Drop(SidedFault, section="drop"):
    """A fault that loses each frame with the same probability, independently. `acted` counts the lost frames."""

    probability: Probability

    def change(self, random: Random) -> Change:
        return lambda frame: [] if random.random() < self.probability else [frame]


@dataclass(frozen=True, kw_only=True)
class BurstLoss(SidedFault, section="burst_loss"):
    """A fault that loses frames in bursts of geometrically distributed length. `acted` counts the lost frames.

    A Markov chain has two states: a frame in the bad state is lost, a frame in the good state is not (Gilbert,
    "Capacity of a burst-noise channel", Bell System Technical Journal 39 (1960), with Elliott's (1963) error
    probabilities of 0 and 1). The chain makes a step with each frame and starts in its stationary distribution.
    """

    loss: Fraction[float]
    """Long-term share of lost frames."""
    mean_burst: Annotated[float, at_least(1)]
    """Mean number of consecutive frames that a burst loses."""

    def __post_init__(self) -> None:
        super().__post_init__()
        most = self.mean_burst / (self.mean_burst + 1.0)
        wording = f"at most {most:g} with bursts of {self.mean_burst:g}: at least one frame passes between two bursts"
        require(self.loss <= most, self, "loss", wording)

    def change(self, random: Random) -> Change:
        to_good = 1.0 / self.mean_burst
        to_bad = to_good * self.loss / (1.0 - self.loss)
        # The chain starts in its stationary distribution: the first state is bad with probability `loss`.
        bad = random.random() < self.loss

        def change(frame: Frame) -> list[Frame]:
            nonlocal bad
            bad = random.random() < (1.0 - to_good if bad else to_bad)
            return [] if bad else [frame]

        return change


@dataclass(frozen=True, kw_only=True)
class Duplicate(SidedFault, section="duplicate"):
    """A fault that adds copies directly after a frame, with the same time stamp. `acted` counts the copied frames."""

    probability: Probability = 1.0
    copies: AtLeastOne[int] = 1

    def change(self, random: Random) -> Change:
        return lambda frame: [frame] * (1 + self.copies) if random.random() < self.probability else [frame]


@dataclass(frozen=True, kw_only=True)
class Delay(FrameFault, section="delay"):
    """A fault that holds frames for a time from `Injector.arrived` on, in order. `acted` counts the late frames."""

    delay_s: NonNegative[float]
    """Smallest delay in s."""
    jitter_s: NonNegative[float] = 0.0
    """Largest additional delay in s; the additional delay is distributed uniformly between 0 and this value."""
    restamp: bool = True
    """Whether the delay also shifts the time stamp, as if the frame waited in a gateway before it was stamped.
    Otherwise the stamp stays unchanged, as if the frame waited in a queue of the receiver after it was stamped."""

    def acting(self, port: Injector) -> tuple[Send, Receive]:
        waiting: list[tuple[int, int, Frame]] = []  # due time in ns, serial number, frame
        serial, last_due_ns = count(), 0

        def receive() -> list[Frame]:
            nonlocal last_due_ns
            now_ns = port.clock()
            for arrived_ns, frame in port.arrived(now_ns):
                due_ns = arrived_ns
                if self.concerns(frame):
                    if self.is_active(arrived_ns):
                        due_ns += round((self.delay_s + port.random.random() * self.jitter_s) * NS)
                    # No frame overtakes another frame in the queue, even if it arrives after the fault's span.
                    due_ns = last_due_ns = max(due_ns, last_due_ns)
                port.acted += due_ns > arrived_ns
                stamp_ns = frame.timestamp_ns + (due_ns - arrived_ns if self.restamp else 0)
                heapq.heappush(waiting, (due_ns, next(serial), replace(frame, timestamp_ns=stamp_ns)))
            due: list[Frame] = []
            while waiting and waiting[0][0] <= now_ns:
                due.append(heapq.heappop(waiting)[2])
            return due

        return port.beneath.send, receive


@dataclass(frozen=True, kw_only=True)
class Reorder(FrameFault, section="reorder"):
    """A fault that collects groups of `window` frames, and delivers each group in random order. The first call of
    `receive_all` after the span delivers all waiting frames. `acted` counts the frames that change places."""

    window: Annotated[int, at_least(1)] = 2

    def acting(self, port: Injector) -> tuple[Send, Receive]:
        kept: list[Frame] = []

        def shuffled() -> list[Frame]:
            order = list(range(len(kept)))
            port.random.shuffle(order)
            port.acted += sum(place != index for place, index in enumerate(order))
            frames = [kept[index] for index in order]
            kept.clear()
            return frames

        def receive() -> list[Frame]:
            now_ns = port.clock()
            frames: list[Frame] = []
            for arrived_ns, frame in port.arrived(now_ns):
                if not self.concerns(frame):
                    frames.append(frame)
                elif not self.is_active(arrived_ns):
                    frames += [*shuffled(), frame]
                else:
                    kept.append(frame)
                    if len(kept) == self.window:
                        frames += shuffled()
            return frames if self.is_active(now_ns) else [*frames, *shuffled()]

        return port.beneath.send, receive


_SPECS: Final = {spec.frame_id: spec for spec in SPECS}


@dataclass(frozen=True, kw_only=True)
class FlipBits(SidedFault, section="flip_bits"):
    """A fault that inverts bits of the data. `acted` counts the changed frames."""

    probability: Probability = 1.0
    bits: AtLeastOne[int] = 1
    """Number of different bits that are inverted in one frame. If a frame has fewer bits, all its bits are inverted."""
    before_crc: bool = False
    """Whether the bits change before the end-to-end CRC is computed, so that the CRC fits the wrong data. If true, only
    stillwake's messages are changed. If false, the bits change later, as in a driver or a gateway."""

    def change(self, random: Random) -> Change:
        """Return a function that flips bits. With `before_crc`, it raises BusError for an authenticated frame."""
        return lambda frame: [self._flipped(frame, random) if random.random() < self.probability else frame]

    def _flipped(self, frame: Frame, random: Random) -> Frame:
        spec = _spec_of(frame) if self.before_crc else None
        if self.before_crc and spec is None:
            return frame
        first_bit = 0 if spec is None else profile_of(spec).header_bits
        places = range(first_bit, 8 * len(frame.data))  # bit j of byte i has position 8 * i + j
        changed = bytearray(frame.data)
        for place in random.sample(places, min(self.bits, len(places))):
            changed[place // 8] ^= 1 << place % 8
        data = bytes(changed)
        return replace(frame, data=data) if spec is None else _reprotected(frame, data, spec)


@dataclass(frozen=True, kw_only=True)
class StuckAt(SidedFault, section="stuck_at"):
    """A fault that repeats the data of each identifier's first frame in the span. `acted` counts the changed frames."""

    counter_runs: bool = False
    """Whether counter and CRC are renewed in each frame, as if only the application were stuck. If true, only
    stillwake's messages are changed. If false, all data repeat, as from a buffer that is not refilled."""

    def change(self, random: Random) -> Change:
        """Return a function that repeats data. With `counter_runs`, it raises BusError for an authenticated frame."""
        first: dict[tuple[bool, int], bytes] = {}

        def change(frame: Frame) -> list[Frame]:
            data = first.setdefault((frame.is_extended, frame.frame_id), frame.data)
            if not self.counter_runs:
                return [replace(frame, data=data)]
            spec = _spec_of(frame)
            return [frame if spec is None else _reprotected(frame, data, spec)]

        return change


def _spec_of(frame: Frame) -> MessageSpec | None:
    """Return the specification of a frame's message; None if the message is not one of stillwake's. Raises BusError for
    an authenticated frame, because its MAC cannot be recomputed without the key."""
    spec = _SPECS.get(frame.frame_id)
    if spec is None or not spec.names(frame) or len(frame.data) != spec.length:
        return None
    if spec.is_secured:
        raise BusError(f"{spec.name} is authenticated: a fault needs the key to change its data before protection")
    return spec


def _reprotected(frame: Frame, data: bytes, spec: MessageSpec) -> Frame:
    profile = profile_of(spec)
    protected = profile.protect(data, data_id=spec.data_id, counter=profile.counter_of(frame.data))
    return replace(frame, data=protected)


@dataclass(frozen=True, kw_only=True)
class WireErrors(Span, section="wire_errors"):
    """A fault that inverts each bit independently with equal probability; only a frame's first wrong bit counts."""

    bit_error_rate: Probability
    nodes: tuple[str, ...] = ()
    """Names of ports; empty for all. If a bus uses the fault as `corrupts`, all nodes see wrong bits in frames of these
    ports. If a bus uses it as `mishears`, only these ports see wrong bits in the frames that they receive."""
    frame_ids: tuple[int, ...] = ()
    """See `FrameFault.frame_ids`."""

    def hook(self, seed: int) -> Callable[[Frame, str, int], int | None]:
        """Return a function to pass to a `SimulatedBus` as `corrupts` or `mishears`. Call `hook` once for each bus."""
        random = Random(f"{seed} {self.section}")
        rate = self.bit_error_rate

        def first_wrong_bit(frame: Frame, node: str, begin_ns: int) -> int | None:
            if (self.nodes and node not in self.nodes) or (self.frame_ids and frame.frame_id not in self.frame_ids):
                return None
            if rate == 0.0 or not self.is_active(begin_ns):
                return None
            # The index of the first wrong bit is distributed geometrically, because the bits are independent.
            draw = random.random()
            place = 0 if rate == 1.0 else int(log1p(-draw) / log1p(-rate))
            intermission = 3
            return place if place < sum(sent_bits(frame).total) - intermission else None

        return first_wrong_bit
