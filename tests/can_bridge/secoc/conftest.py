"""A key, a genuine frame of each secured message, and numbers to vary it by."""

from collections.abc import Callable

import pytest

from can_bridge.e2e.sender import SenderState, protected_frame
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import Freshness, secure
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import MessageSpec

SECRET = bytes(range(0x10, 0x20))


@pytest.fixture(scope="session")
def key() -> Key:
    return Key(SECRET)


@pytest.fixture(scope="session")
def genuine(key) -> Callable[..., Frame]:
    """A frame as its sender makes it."""

    def make(spec: MessageSpec, *, trip: int = 1, count: int = 0, content: int = 0x5A, by: Key = key) -> Frame:
        plain = protected_frame(
            SenderState(counter=count % 256), bytes([content] * spec.protected), spec=spec, now_ns=count
        )
        return secure(plain, spec, by, Freshness(trip=trip, count=count))

    return make
