"""Frames that arrive with other data: flipped bits, and a node that sends the same for ever.

CAN's own CRC does not see these faults: they happen before the sender's CAN controller or behind the receiver's.
Errors on the wire itself are `wire_errors.py`.
"""

from dataclasses import dataclass, replace
from random import Random
from typing import Final

from can_bridge.bus.faults.fault import Change, Probability, SidedFault
from can_bridge.e2e.profiles import profile_of
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import SPECS, MessageSpec
from contract.config.rules import AtLeastOne
from contract.errors import BusError

_SPECS: Final = {spec.frame_id: spec for spec in SPECS}


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
        spec = _spec_of(frame) if self.before_crc else None
        if self.before_crc and spec is None:
            return frame
        places = range(8 * len(frame.data)) if spec is None else payload_bits(spec)
        changed = bytearray(frame.data)
        for place in random.sample(places, min(self.bits, len(places))):
            changed[place // 8] ^= 1 << place % 8
        data = bytes(changed)
        return replace(frame, data=data) if spec is None else _reprotected(frame, data, spec)


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
            spec = _spec_of(frame)
            return [frame if spec is None else _reprotected(frame, data, spec)]

        return change


def _spec_of(frame: Frame) -> MessageSpec | None:
    """The message that a frame carries; None if it is none of ours. Raises BusError for an authenticated one, which
    only the holder of the key could make again."""
    spec = _SPECS.get(frame.frame_id)
    if spec is None or not spec.names(frame) or len(frame.data) != spec.length:
        return None
    if spec.is_secured:
        raise BusError(f"{spec.name} is authenticated: a fault ahead of its protection would need the key")
    return spec


def payload_bits(spec: MessageSpec) -> range:
    """The bits that the header leaves to the message, the least significant bit of a byte first."""
    return range(profile_of(spec).header_bits, 8 * spec.protected)


def _reprotected(frame: Frame, data: bytes, spec: MessageSpec) -> Frame:
    """The frame with other data and a CRC that fits; the counter stays."""
    profile = profile_of(spec)
    protected = profile.protect(data, data_id=spec.data_id, counter=profile.counter_of(frame.data))
    return replace(frame, data=protected)
