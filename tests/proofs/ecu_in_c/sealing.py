"""A sender's side of authentication, by chance: genuine frames, and forged, repeated and misshapen ones."""

from random import Random

from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import LARGEST_HALF, Freshness, secure
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import MessageSpec
from contract.config.tree import Config
from tests.proofs.ecu_in_c.variants import KEY

_ANOTHER = Key(bytes(range(2, 18)))


class Sealing:
    """Freshness and MAC for the frames of one sender; nothing without a key."""

    def __init__(self, config: Config, rng: Random) -> None:
        self._is_keyed, self._rng = bool(config.bus.key), rng
        self._freshness, self._sent = Freshness(trip=6), list[Frame]()

    def restart(self) -> None:
        self._freshness = Freshness(trip=self._freshness.trip + 1)

    def sealed(self, frame: Frame, spec: MessageSpec, odd: float) -> Frame:
        if not self._is_keyed:
            return frame
        rng, freshness = self._rng, self._freshness
        self._freshness = freshness.next()
        if rng.random() >= odd / 3:
            self._sent = [*self._sent[-9:], secure(frame, spec, KEY, freshness)]
            return self._sent[-1]
        deed = rng.choice(("forged", "repeated", "flipped", "spoilt", "short", "bare", "jump", "back", "far"))
        if deed == "repeated" and self._sent:
            return rng.choice(self._sent)
        if deed == "jump":
            self._freshness = Freshness(trip=freshness.trip, count=freshness.count + rng.randrange(1, 300))
        if deed == "back":
            freshness = Freshness(trip=rng.choice((1, freshness.trip)), count=max(0, freshness.count - 1))
        if deed == "far" and rng.random() < 0.003:
            freshness = Freshness(trip=LARGEST_HALF, count=LARGEST_HALF)
        if deed == "spoilt":
            # Authentic, and wrong by its CRC.
            frame = _with_bit(frame, rng.randrange(8 * len(frame.data)))
        found = secure(frame, spec, _ANOTHER if deed == "forged" else KEY, freshness)
        if deed == "flipped":
            return _with_bit(found, rng.randrange(8 * len(found.data)))
        if deed == "short":
            return _of(found, found.data[: rng.choice((0, 8, 12, 16))])
        return frame if deed == "bare" else found


def _of(frame: Frame, data: bytes) -> Frame:
    return Frame(frame_id=frame.frame_id, data=data, is_fd=frame.is_fd)


def _with_bit(frame: Frame, bit: int) -> Frame:
    data = bytearray(frame.data)
    data[bit // 8] ^= 1 << bit % 8
    return _of(frame, bytes(data))
