"""Which of two frames wins the arbitration of a CAN bus."""

from typing import Final

from can_bridge.wire.frame import Frame

EXTENSION_BITS: Final = 18

Priority = tuple[int, bool, int]
"""The smaller wins arbitration."""


def priority(frame: Frame) -> Priority:
    """In the order of the bits: the leading 11 of the identifier, then SRR and IDE, which are recessive in the long
    format, then its other 18. Frames of equal priority have the same identifier; their contents do not arbitrate.
    """
    if frame.is_extended:
        return frame.frame_id >> EXTENSION_BITS, True, frame.frame_id & (1 << EXTENSION_BITS) - 1
    return frame.frame_id, False, 0
