"""A request that is being worked on, and when the tester has to hear that it takes longer (ISO 14229-2, P2 and P2*)."""

from collections.abc import Collection
from typing import Final

from can_bridge.uds.diagnostics import Long
from can_bridge.uds.refused import Refused
from can_bridge.uds.services import P2_EXTENDED_MS, P2_MS, Nrc

_MS: Final = 1_000_000
_FIRST_NS: Final = P2_MS * _MS // 2
_NEXT_NS: Final = P2_EXTENDED_MS * _MS // 2
"""Half the limits, which are for the last moment on the bus."""
_POSITIVE: Final = 0x40
_NEGATIVE: Final = 0x7F


def negative(service: int, code: Nrc) -> bytes:
    """A negative response."""
    return bytes([_NEGATIVE, service, code])


class Job:
    """Work whose return value is the answer after its first byte. `is_quiet`: the tester wants no positive answer.
    `passed_over`: codes of refusals that it does not want, either."""

    def __init__(
        self, now_ns: int, service: int, work: Long[bytes], *, is_quiet: bool, passed_over: Collection[Nrc] = ()
    ) -> None:
        self.service = service
        self._work = work
        self._is_quiet, self._passed_over = is_quiet, passed_over
        self._pending_ns = now_ns + _FIRST_NS
        self.is_done = False

    def go_on(self, now_ns: int) -> list[bytes]:
        """One piece; what is to be sent now."""
        sent = []
        if now_ns >= self._pending_ns:
            # A tester that received response-pending waits for the answer, even if it wanted none.
            self._is_quiet, self._passed_over = False, ()
            self._pending_ns = now_ns + _NEXT_NS
            sent.append(negative(self.service, Nrc.RESPONSE_PENDING))
        try:
            next(self._work)
        except StopIteration as end:
            self.is_done = True
            if not self._is_quiet:
                sent.append(bytes([self.service + _POSITIVE]) + end.value)
        except Refused as refusal:
            self.is_done = True
            if refusal.code not in self._passed_over:
                sent.append(negative(self.service, refusal.code))
        return sent
