"""Putting a message together from frames; what comes out is whole, or nothing does."""

from can_bridge.isotp.control_info import SEQUENCE_NUMBERS, Consecutive, First, FlowStatus
from can_bridge.isotp.settings import IsoTpSettings


class Reception:
    """At most one message on the way.

    Attributes:
        aborted: messages that were begun and not ended.
    """

    def __init__(self, settings: IsoTpSettings) -> None:
        self._settings = settings
        self._wanted = 0
        self._frame_length = 0
        self._next_number = 0
        self._left_in_block = 0
        self._deadline_ns = 0
        self._data = bytearray()
        self.aborted = 0

    @property
    def is_running(self) -> bool:
        return self._wanted > 0

    def abort(self) -> None:
        """Drop what has come of a message."""
        if self._wanted:
            self.aborted += 1
            self._wanted = 0
            self._data.clear()

    def tick(self, now_ns: int) -> None:
        """Drop a message whose next frame is overdue."""
        if self._wanted and now_ns > self._deadline_ns:
            self.abort()

    def first(self, now_ns: int, part: First) -> FlowStatus:
        """A message begins, and replaces one that is on the way; the result is our answer."""
        self.abort()
        if part.length > self._settings.max_message:
            return FlowStatus.OVERFLOW
        self._wanted = part.length
        self._frame_length = part.frame_length
        self._data += part.data
        self._next_number = 1
        self._left_in_block = self._settings.block_size
        self._deadline_ns = now_ns + self._settings.n_cr_ns
        return FlowStatus.CONTINUE

    def consecutive(self, now_ns: int, part: Consecutive) -> tuple[bytes | None, FlowStatus | None]:
        """The next piece: the message if it is whole now, and our answer if one is due."""
        if not self._wanted:
            return None, None
        if part.number != self._next_number:
            self.abort()
            return None, None
        missing = self._wanted - len(self._data)
        longest = self._frame_length - 1
        if not min(missing, longest) <= len(part.data) <= longest:
            # Only a last frame may be shorter than the first. The next one then has the wrong number.
            return None, None
        self._data += part.data[:missing]
        self._next_number = (self._next_number + 1) % SEQUENCE_NUMBERS
        self._deadline_ns = now_ns + self._settings.n_cr_ns
        if len(self._data) == self._wanted:
            message = bytes(self._data)
            self._data.clear()
            self._wanted = 0
            return message, None
        if self._left_in_block:
            self._left_in_block -= 1
            if not self._left_in_block:
                self._left_in_block = self._settings.block_size
                return None, FlowStatus.CONTINUE
        return None, None
