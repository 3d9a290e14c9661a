"""What a fault before the end-to-end protection needs: other data under the header the sender would have made."""

from dataclasses import replace
from typing import Final

from can_bridge.e2e.profiles import profile_of
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import SPECS, MessageSpec
from contract.errors import BusError

_SPECS: Final = {spec.frame_id: spec for spec in SPECS}


def spec_of(frame: Frame) -> MessageSpec | None:
    """The message that a frame carries; None if it is none of ours.

    Raises:
        BusError: for an authenticated one, which only the holder of the key could make again.
    """
    spec = _SPECS.get(frame.frame_id)
    if spec is None or not spec.names(frame) or len(frame.data) != spec.length:
        return None
    if spec.is_secured:
        raise BusError(f"{spec.name} is authenticated: a fault ahead of its protection would need the key")
    return spec


def payload_bits(spec: MessageSpec) -> range:
    """The bits that the header leaves to the message, the least significant bit of a byte first."""
    return range(profile_of(spec).header_bits, 8 * spec.protected)


def reprotected(frame: Frame, data: bytes, spec: MessageSpec) -> Frame:
    """The frame with other data and a CRC that fits; the counter stays."""
    profile = profile_of(spec)
    protected = profile.protect(data, data_id=spec.data_id, counter=profile.counter_of(frame.data))
    return replace(frame, data=protected)
