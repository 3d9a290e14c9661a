"""The data that a node needs to secure its frames and to verify another node's frames."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from can_bridge.secoc.key import Key, read_key
from can_bridge.secoc.securing import Freshness, VerifierState, secure
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import MessageSpec
from contract.config.vehicle import BusConfig
from contract.errors import ConfigError


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
