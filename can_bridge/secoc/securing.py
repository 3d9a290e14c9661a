"""The functions that secure and verify frames, and the data that a node needs for them. A frame that is not authentic
or fresh is dropped before the E2E check.

    protected part (E2E header first) | zeros | freshness, 8 bytes | MAC, 8 bytes

The MAC is the first 8 bytes of AES-128 CMAC over the data ID (2 bytes), everything before the freshness, and the
freshness. As in AUTOSAR SecOC, numbers have their most significant byte first. The data ID is not sent; it binds a
frame to its message. A forged or repeated frame changes neither E2E counter nor window, so the stream continues.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from hmac import compare_digest
from pathlib import Path
from typing import Final, NamedTuple, Self

from can_bridge.secoc.key import Key, read_key
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import FRESHNESS_LENGTH, MAC_LENGTH, MessageSpec
from contract.config.vehicle import BusConfig
from contract.errors import ConfigError

LARGEST_HALF: Final = 0xFFFFFFFF
"""The largest number of a power cycle, and of a frame within a power cycle."""
LARGEST_FRESHNESS: Final = 0xFFFFFFFFFFFFFFFF


@dataclass(frozen=True, kw_only=True)
class Freshness:
    """The freshness of one message of a sender, as in AUTOSAR SecOC. Raises ValueError for a counter out of range.

    Attributes:
        trip: number of power cycles, including this one; at least 1, so that every value is greater than 0.
        count: number of the message's frames already sent in this power cycle.
    """

    trip: int = 1
    count: int = 0

    def __post_init__(self) -> None:
        for name, value, least in (("trip", self.trip, 1), ("count", self.count, 0)):
            if not least <= value <= LARGEST_HALF:
                raise ValueError(f"freshness: {name} = {value}: must be in {least}..{LARGEST_HALF}")

    @property
    def value(self) -> int:
        """The freshness value that is sent: 64 bits, with the trip in the upper half."""
        return self.trip << 32 | self.count

    def next(self) -> Self:
        """Return the freshness of the next frame. After 2^32 frames (2.7 years at 20 ms) the count stays constant.
        Receivers then refuse every frame, and the jets stay shut, until the power is switched off and on."""
        return type(self)(trip=self.trip, count=min(self.count + 1, LARGEST_HALF))


def secure(frame: Frame, spec: MessageSpec, key: Key, freshness: Freshness) -> Frame:
    """Return a frame as sent on the bus. Raises ValueError unless the frame is a secured message's protected part."""
    if not spec.is_secured:
        raise ValueError(f"{spec.name} has no room for a MAC")
    if len(frame.data) != spec.protected:
        raise ValueError(f"{spec.name} has {len(frame.data)} bytes: must have {spec.protected} before it is secured")
    covered = frame.data.ljust(spec.length - FRESHNESS_LENGTH - MAC_LENGTH, b"\0")
    covered += freshness.value.to_bytes(FRESHNESS_LENGTH, "big")
    data = covered + _mac(covered, spec, key)
    return Frame(frame_id=frame.frame_id, data=data, timestamp_ns=frame.timestamp_ns, is_fd=frame.is_fd)


def verify(data: bytes, spec: MessageSpec, key: Key) -> int | None:
    """Return the freshness value of an authentic frame's data, or None for any other bytes. Never raises."""
    if len(data) != spec.length:
        return None
    covered = data[:-MAC_LENGTH]
    # The time of the comparison must not depend on the number of equal bytes.
    if not compare_digest(data[-MAC_LENGTH:], _mac(covered, spec, key)):
        return None
    return int.from_bytes(covered[-FRESHNESS_LENGTH:], "big")


def _mac(covered: bytes, spec: MessageSpec, key: Key) -> bytes:
    return key.cmac(spec.data_id.to_bytes(2, "big") + covered)[:MAC_LENGTH]


@dataclass(frozen=True, kw_only=True)
class VerifierState:
    """The state of the receiver of one secured message.

    Attributes:
        freshness: freshness value of the latest accepted frame; 0 before the first accepted frame.
        not_authentic: number of frames refused because of their length or MAC.
        not_fresh: number of authentic frames whose freshness value is old: they were repeated or recorded earlier.
    """

    freshness: int = 0
    not_authentic: int = 0
    not_fresh: int = 0

    @property
    def refused(self) -> int:
        return self.not_authentic + self.not_fresh


class Verification(NamedTuple):
    """The frames that passed in a period. `none_authentic` is true if the message arrived only in refused frames."""

    state: VerifierState
    frames: Sequence[Frame]
    none_authentic: bool


def verified(state: VerifierState, frames: Sequence[Frame], *, spec: MessageSpec, key: Key | None) -> Verification:
    """Check a message's frames in a period, oldest first. Frames of other messages pass. Without a key, all pass."""
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


@dataclass(frozen=True, kw_only=True)
class Authentication:
    """The data with which one node secures and verifies frames in one power cycle.

    Attributes:
        trip: number of the node's power cycles, including this one.
        heard: freshness values accepted in earlier power cycles, by frame identifier.
    """

    key: Key = field(repr=False)
    trip: int = 1
    heard: Mapping[int, int] = field(default_factory=dict)

    @property
    def freshness(self) -> Freshness:
        """The freshness of the first frame of each message that the node sends."""
        return Freshness(trip=self.trip)

    def verifier(self, spec: MessageSpec) -> VerifierState:
        """Return the state that the receiver of a secured message has at power-on."""
        return VerifierState(freshness=self.heard.get(spec.frame_id, 0))


def authentication_in_virtual_time(config: BusConfig) -> Authentication | None:
    """Return a node's data for its first power cycle; None without a key. Raises KeyFileError as `read_key` does."""
    return Authentication(key=read_key(Path(config.key))) if config.key else None


def key_of(authentication: Authentication | None, config: BusConfig) -> Key | None:
    """Return the key to use. Raises ConfigError if only the settings or only the node has a key."""
    if message_set(config).pressure.spec.is_secured != (authentication is not None):
        given = "without a key" if authentication is None else "with a key"
        raise ConfigError(f"bus.key = {config.key!r}: the node was made {given}")
    return None if authentication is None else authentication.key


def secured(frame: Frame, *, spec: MessageSpec, key: Key | None, freshness: Freshness) -> Frame:
    """Return the frame as sent on the bus: with freshness and MAC, or unchanged if `key` is None."""
    return frame if key is None else secure(frame, spec, key, freshness)
