"""Frames that arrive with other data: flipped bits, and a node that sends the same for ever.

CAN's own CRC does not see these faults: they happen before the sender's CAN controller or behind the receiver's.
Errors on the wire itself are `wire_errors.py`.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from random import Random

from can_bridge.bus.faults.fault import Probability
from can_bridge.bus.faults.frame_by_frame import Change, SidedFault
from can_bridge.bus.faults.protection import payload_bits, reprotected, spec_of
from can_bridge.wire.frame import Frame
from contract.config.rules import AtLeastOne


@dataclass(frozen=True, kw_only=True)
class FlipBits(SidedFault, section="flip_bits"):
    """Bits of the data change. `acted` counts the frames that were changed."""

    probability: Probability[float] = 1.0
    """How many bits of a frame flip."""
    bits: AtLeastOne[int] = 1
    """Different bits that change in one frame; all, if it has fewer."""
    before_crc: bool = False
    """The bits change in the sender's memory before it protects the message, so that the end-to-end CRC fits what is
    wrong; frames that are not ours pass as they are. Otherwise they change behind it: in a driver, a gateway or the
    receiver's memory."""

    def change(self, random: Random) -> Change:
        """See `SidedFault.change`; with `before_crc`, passing on an authenticated frame raises BusError."""
        return lambda frame: [self._flipped(frame, random) if random.random() < self.probability else frame]

    def _flipped(self, frame: Frame, random: Random) -> Frame:
        if not self.before_crc:
            return replace(frame, data=_with_flips(frame.data, self._drawn(range(8 * len(frame.data)), random)))
        spec = spec_of(frame)
        if spec is None:
            return frame
        return reprotected(frame, _with_flips(frame.data, self._drawn(payload_bits(spec), random)), spec)

    def _drawn(self, places: range, random: Random) -> list[int]:
        return random.sample(places, min(self.bits, len(places)))


@dataclass(frozen=True, kw_only=True)
class StuckAt(SidedFault, section="stuck_at"):
    """A node sends the data of the first frame in the span for ever, by identifier. `acted` counts the changed."""

    counter_runs: bool = False
    """Counter and CRC go on, as when the application is stuck and the communication stack below it is not; frames that
    are not ours pass as they are. Otherwise the whole frame is the same to the bit, as when a buffer is not refilled.
    """

    def change(self, random: Random) -> Change:
        """See `SidedFault.change`; with `counter_runs`, passing on an authenticated frame raises BusError."""
        first: dict[tuple[bool, int], bytes] = {}

        def change(frame: Frame) -> list[Frame]:
            data = first.setdefault((frame.is_extended, frame.frame_id), frame.data)
            if not self.counter_runs:
                return [replace(frame, data=data)]
            spec = spec_of(frame)
            return [frame if spec is None else reprotected(frame, data, spec)]

        return change


def _with_flips(data: bytes, places: Iterable[int]) -> bytes:
    """The least significant bit of the first byte is place 0."""
    changed = bytearray(data)
    for place in places:
        changed[place // 8] ^= 1 << place % 8
    return bytes(changed)
