"""Bringing a key list into an ECU, as steps over an open client."""

from can_bridge.tester.asking import Asking
from can_bridge.tester.messages import RefusedError, WrongKeysError
from can_bridge.tester.transfer import enter_programming
from can_bridge.uds.services import Did, Nrc, Session


def bring(asking: Asking, raw: bytes) -> tuple[int, int]:
    """Replace the key list; returns the version of the one before, 0 without one, and of the new one. Raises
    WrongKeysError if the ECU does not take it; FlashError if not now, or it does not answer."""
    before = _version(asking)
    enter_programming(asking)
    try:
        asking.write(Did.KEY_LIST, raw)
    except RefusedError as refused:
        if refused.code != Nrc.OUT_OF_RANGE:
            raise
        raise WrongKeysError(
            f"the ECU refused the key list: it must be signed by the ECU's root key, have a version above {before}, "
            "and keep the key that signed the confirmed release"
        ) from refused
    after = _version(asking)
    asking.session(Session.DEFAULT)
    return before, after


def _version(asking: Asking) -> int:
    return int.from_bytes(asking.read(Did.KEY_LIST), "big")
