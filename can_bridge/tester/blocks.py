"""How long the next block of a transfer is: long ones are quick on a good bus, short ones arrive on a bad one.

A block is lost with any of its frames, so that where one frame in a hundred is lost hardly any of the 583 frames long
blocks of classic CAN arrives. The length is halved after a block that did not, and doubled after some that did.
"""

from typing import Final

from can_bridge.uds.services import MAX_BLOCK

STEP: Final = 32
"""Blocks begin at multiples of this, a word of flash memory."""
_HEADER: Final = 2
_IN_A_ROW: Final = 16
"""Blocks that arrive at once before a longer one is tried."""


class BlockLength:
    """The length of one image's blocks, over all attempts to transfer it."""

    def __init__(self) -> None:
        self._longest = self._limit = (MAX_BLOCK - _HEADER) // STEP * STEP
        self._good = 0

    def allow(self, longest_request: int) -> None:
        """What the ECU takes in one request, in bytes."""
        self._limit = max(STEP, (min(longest_request, MAX_BLOCK) - _HEADER) // STEP * STEP)

    def next_from(self, offset: int) -> int:
        """Bytes of a block that begins at this offset of the image."""
        return min(self._longest, self._limit) - offset % STEP

    def arrived(self) -> None:
        """A block did at once."""
        self._good += 1
        if self._good >= _IN_A_ROW:
            self._good = 0
            self._longest = min(2 * self._longest, self._limit)

    def lost(self) -> None:
        """A block was, or its answer."""
        self._good = 0
        self._longest = max(STEP, self._longest // 2 // STEP * STEP)
