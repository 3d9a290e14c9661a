"""One frame secured, and one frame verified.

    protected part (E2E header first) | zeros | freshness, 8 bytes | MAC, 8 bytes

The MAC is the first 8 bytes of AES-128 CMAC over the data ID (2 bytes), everything in front of the freshness, and the
freshness; numbers have their most significant byte first, as AUTOSAR SecOC has them. The data ID, which is not sent,
binds a frame to its message.
"""

from hmac import compare_digest

from can_bridge.secoc.freshness import Freshness
from can_bridge.secoc.key import Key
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import FRESHNESS_LENGTH, MAC_LENGTH, MessageSpec


def secure(frame: Frame, spec: MessageSpec, key: Key, freshness: Freshness) -> Frame:
    """The frame of a message as it goes onto the bus, from the one with its protected part alone. Raises ValueError if
    the message is not a secured one, or the frame not its protected part."""
    if not spec.is_secured:
        raise ValueError(f"{spec.name}: has no room for a MAC")
    if len(frame.data) != spec.protected:
        raise ValueError(f"{spec.name} of {len(frame.data)} bytes: must have {spec.protected} before it is secured")
    covered = frame.data.ljust(spec.length - FRESHNESS_LENGTH - MAC_LENGTH, b"\0")
    covered += freshness.value.to_bytes(FRESHNESS_LENGTH, "big")
    data = covered + _mac(covered, spec, key)
    return Frame(frame_id=frame.frame_id, data=data, timestamp_ns=frame.timestamp_ns, is_fd=frame.is_fd)


def verify(data: bytes, spec: MessageSpec, key: Key) -> int | None:
    """The freshness value of an authentic frame's data; None for any other bytes. Never raises."""
    if len(data) != spec.length:
        return None
    covered = data[:-MAC_LENGTH]
    # In a time that does not depend on how much of it fits.
    if not compare_digest(data[-MAC_LENGTH:], _mac(covered, spec, key)):
        return None
    return int.from_bytes(covered[-FRESHNESS_LENGTH:], "big")


def _mac(covered: bytes, spec: MessageSpec, key: Key) -> bytes:
    return key.cmac(spec.data_id.to_bytes(2, "big") + covered)[:MAC_LENGTH]
