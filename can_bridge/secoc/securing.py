"""Frames secured, and frames verified: what is not authentic or not fresh is dropped before E2E looks at it.

    protected part (E2E header first) | zeros | freshness, 8 bytes | MAC, 8 bytes

The MAC is the first 8 bytes of AES-128 CMAC over the data ID (2 bytes), everything in front of the freshness, and the
freshness; numbers have their most significant byte first, as AUTOSAR SecOC has them. The data ID, which is not sent,
binds a frame to its message. A forged or repeated frame cannot disturb the genuine stream: neither its counter nor its
window sees it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from hmac import compare_digest
from typing import Final, NamedTuple, Self

from can_bridge.secoc.key import Key
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import FRESHNESS_LENGTH, MAC_LENGTH, MessageSpec

LARGEST_HALF: Final = 0xFFFFFFFF
"""The largest number of a power cycle, and of a frame in one."""
LARGEST_FRESHNESS: Final = 0xFFFFFFFFFFFFFFFF


@dataclass(frozen=True, kw_only=True)
class Freshness:
    """The freshness of one sender, as AUTOSAR SecOC has it with a trip counter and a message counter. Raises ValueError
    for a half that does not fit 32 bits.

    Attributes:
        trip: power cycles, this one included; from 1 on, so that every value is greater than 0.
        count: frames of the message sent in this one before.
    """

    trip: int = 1
    count: int = 0

    def __post_init__(self) -> None:
        for name, value, least in (("trip", self.trip, 1), ("count", self.count, 0)):
            if not least <= value <= LARGEST_HALF:
                raise ValueError(f"freshness {name} {value}: must be in {least}..{LARGEST_HALF}")

    @property
    def value(self) -> int:
        """The number that is sent: 64 bits, the trip in the upper half."""
        return self.trip << 32 | self.count

    def next(self) -> Self:
        """The freshness of the next frame.

        After 2^32 frames, 2.7 years at 20 ms, it stays: receivers then refuse every frame, and the jets shut, until
        the power has been off once.
        """
        return type(self)(trip=self.trip, count=min(self.count + 1, LARGEST_HALF))


def secure(frame: Frame, spec: MessageSpec, key: Key, freshness: Freshness) -> Frame:
    """The frame of a message as it goes onto the bus, from the one with its protected part alone. Raises ValueError if
    the message is not a secured one, or the frame not its protected part."""
    if not spec.is_secured:
        raise ValueError(f"{spec.name}: has no room for a MAC")
    if len(frame.data) != spec.protected:
        raise ValueError(f"{spec.name} of {len(frame.data)} bytes: must have {spec.protected} before it is secured")
    covered = frame.data.ljust(spec.length - FRESHNESS_LENGTH - MAC_LENGTH, b"\0")
    covered += freshness.value.to_bytes(FRESHNESS_LENGTH, "big")
    data = covered + _mac(covered, spec, key)
    return Frame(frame_id=frame.frame_id, data=data, timestamp_ns=frame.timestamp_ns, is_fd=frame.is_fd)


def verify(data: bytes, spec: MessageSpec, key: Key) -> int | None:
    """The freshness value of an authentic frame's data; None for any other bytes. Never raises."""
    if len(data) != spec.length:
        return None
    covered = data[:-MAC_LENGTH]
    # In a time that does not depend on how much of it fits.
    if not compare_digest(data[-MAC_LENGTH:], _mac(covered, spec, key)):
        return None
    return int.from_bytes(covered[-FRESHNESS_LENGTH:], "big")


def _mac(covered: bytes, spec: MessageSpec, key: Key) -> bytes:
    return key.cmac(spec.data_id.to_bytes(2, "big") + covered)[:MAC_LENGTH]


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
