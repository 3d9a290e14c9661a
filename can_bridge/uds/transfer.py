"""The blocks of a download in their order (ISO 14229-1, services 0x34, 0x36, 0x37).

A tester that missed an answer sends its request again. So the block that was taken last is acknowledged again without
being written again, and so are a download of which no block has come yet and an exit.
"""

from can_bridge.uds.refused import Refused
from can_bridge.uds.services import Nrc


class Transfer:
    """A download that was asked for.

    Args:
        offset: of its first byte in the image.
        length: bytes that will come, in all its blocks.

    Attributes:
        is_closed: it was exited; only a repeated exit is still answered.
    """

    def __init__(self, offset: int, length: int) -> None:
        self.offset = offset
        self.length = length
        self._missing = length
        self._expected = 1
        self._last: tuple[int, bytes] | None = None
        self.is_closed = False

    @property
    def has_begun(self) -> bool:
        return self._last is not None

    def is_new(self, counter: int, data: bytes) -> bool:
        """Whether to write this block; False if it is the last one again. Raises Refused with the code of what is
        wrong with it."""
        if self._last == (counter, data) and not self.is_closed:
            return False
        if self._missing == 0:
            raise Refused(Nrc.SEQUENCE_ERROR)
        if counter != self._expected:
            raise Refused(Nrc.WRONG_BLOCK_COUNTER)
        if len(data) > self._missing:
            raise Refused(Nrc.TRANSFER_SUSPENDED)
        return True

    def taken(self, counter: int, data: bytes) -> None:
        """This block was written."""
        self._missing -= len(data)
        self._expected = (counter + 1) % 256
        self._last = counter, data

    def check_complete(self) -> None:
        """Raises Refused if bytes are missing."""
        if self._missing:
            raise Refused(Nrc.SEQUENCE_ERROR)
