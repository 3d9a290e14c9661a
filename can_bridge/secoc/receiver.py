"""The receiving end of a secured message: what is not authentic or not fresh is dropped before E2E looks at it.

So a forged or repeated frame cannot disturb the genuine stream: neither its counter nor its window sees it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import verify
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import MessageSpec


@dataclass(frozen=True, kw_only=True)
class VerifierState:
    """What the receiver of one secured message must remember.

    Attributes:
        freshness: of the latest accepted frame; 0 before the first.
        not_authentic: frames refused because of length or MAC.
        not_fresh: authentic frames refused because of a freshness value not greater than the one before: repeated,
            or recorded earlier.
    """

    freshness: int = 0
    not_authentic: int = 0
    not_fresh: int = 0

    @property
    def refused(self) -> int:
        """Frames refused for either cause."""
        return self.not_authentic + self.not_fresh


class Verification(NamedTuple):
    """The outcome of one period.

    Attributes:
        frames: those received, without what was refused.
        none_authentic: frames of the message came, and every one was refused.
    """

    state: VerifierState
    frames: Sequence[Frame]
    none_authentic: bool


def verified(state: VerifierState, frames: Sequence[Frame], *, spec: MessageSpec, key: Key | None) -> Verification:
    """Check the frames of one message.

    Args:
        frames: received in this one, oldest first; those of other messages are passed on.
        key: None without authentication; everything is then passed on.
    """
    if key is None:
        return Verification(state, frames, none_authentic=False)
    freshness, not_authentic, not_fresh = state.freshness, state.not_authentic, state.not_fresh
    passed, accepted = list[Frame](), False
    for frame in frames:
        if not spec.names(frame):
            passed.append(frame)
            continue
        received = verify(frame.data, spec, key)
        if received is None:
            not_authentic += 1
        elif received <= freshness:
            not_fresh += 1
        else:
            freshness, accepted = received, True
            passed.append(frame)
    after = VerifierState(freshness=freshness, not_authentic=not_authentic, not_fresh=not_fresh)
    return Verification(after, passed, none_authentic=after.refused > state.refused and not accepted)
