"""The request being processed, and a download (ISO 14229-1 and -2)."""

from collections.abc import Collection

from can_bridge.flashing.backing import Long
from can_bridge.uds.services import NEGATIVE, P2_EXTENDED_MS, P2_MS, POSITIVE, Nrc, Refused

_FIRST_NS, _NEXT_NS = P2_MS * 500_000, P2_EXTENDED_MS * 500_000
"""Times after which a response-pending is sent: half of P2 and half of P2*, so that its last bit is sent in time."""


def negative(service: int, code: Nrc) -> bytes:
    return bytes([NEGATIVE, service, code])


class Job:
    """A request being processed. `work` returns the answer's bytes after the first byte. If `is_quiet`, no positive
    answer is sent. Negative responses with a code in `passed_over` are not sent."""

    def __init__(
        self, now_ns: int, service: int, work: Long[bytes], *, is_quiet: bool, passed_over: Collection[Nrc]
    ) -> None:
        self.service = service
        self._work = work
        self._is_quiet, self._passed_over = is_quiet, passed_over
        self._pending_ns = now_ns + _FIRST_NS
        self.is_done = False

    def go_on(self, now_ns: int) -> list[bytes]:
        """Execute one part of the work; return the responses to send now."""
        sent = []
        if now_ns >= self._pending_ns:
            # After a response-pending the tester waits for an answer, even if the request suppresses answers.
            self._is_quiet, self._passed_over = False, ()
            self._pending_ns = now_ns + _NEXT_NS
            sent.append(negative(self.service, Nrc.RESPONSE_PENDING))
        try:
            next(self._work)
        except StopIteration as end:
            self.is_done = True
            if not self._is_quiet:
                sent.append(bytes([self.service + POSITIVE]) + end.value)
        except Refused as refusal:
            self.is_done = True
            if refusal.code not in self._passed_over:
                sent.append(negative(self.service, refusal.code))
        return sent


class Download:
    """A requested download of `length` bytes, beginning at byte `offset` of the image; `missing` bytes have not come
    yet. After the tester has ended it (`is_closed`), blocks are refused; ending it again is allowed."""

    def __init__(self, offset: int, length: int) -> None:
        self.offset = offset
        self.length = self.missing = length
        self._expected = 1
        self._last: tuple[int, bytes] | None = None
        self.is_closed = False

    def is_new(self, counter: int, data: bytes) -> bool:
        """Return whether to write this block; False if it repeats the last block. Raises Refused for a wrong block."""
        if self._last == (counter, data) and not self.is_closed:
            return False
        if self.missing == 0:
            raise Refused(Nrc.SEQUENCE_ERROR)
        if counter != self._expected:
            raise Refused(Nrc.WRONG_BLOCK_COUNTER)
        if len(data) > self.missing:
            raise Refused(Nrc.TRANSFER_SUSPENDED)
        return True

    def taken(self, counter: int, data: bytes) -> None:
        self.missing -= len(data)
        self._expected = (counter + 1) % 256
        self._last = counter, data
