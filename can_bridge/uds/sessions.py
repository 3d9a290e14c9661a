"""The diagnostic session, which ends by itself when the tester falls silent (S3, ISO 14229-2)."""

from typing import Final

from can_bridge.uds.services import P2_EXTENDED_MS, P2_MS, S3_MS, Session

_MS: Final = 1_000_000
_S3_NS: Final = S3_MS * _MS
_P2_EXTENDED_UNIT_MS: Final = 10


class SessionTimer:
    """Which session it is, and since when the tester has been silent."""

    def __init__(self) -> None:
        self.session = Session.DEFAULT
        self._heard_ns = 0

    def begin(self, now_ns: int, session: Session) -> None:
        self.session, self._heard_ns = session, now_ns

    def hear(self, now_ns: int) -> None:
        """A request was answered or needs no answer, or a message is on its way."""
        self._heard_ns = now_ns

    def is_over(self, now_ns: int) -> bool:
        return self.session is not Session.DEFAULT and now_ns - self._heard_ns >= _S3_NS


def timing_record() -> bytes:
    """P2 in ms and P2* in 10 ms, as the answer to DiagnosticSessionControl has them."""
    return P2_MS.to_bytes(2, "big") + (P2_EXTENDED_MS // _P2_EXTENDED_UNIT_MS).to_bytes(2, "big")
