"""What a vehicle sends, by chance: its speed drifts, jumps, leaves the release's range and returns, is lost, old or
unknown; and frames are secured, forged, repeated and misshapen.
"""

from dataclasses import replace
from random import Random

from can_bridge.e2e.profiles import profile_of
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import LARGEST_HALF, Freshness, secure
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import SPEED_RESOLUTION_M_PER_S, MessageSpec
from can_bridge.wire.messages import VehicleSpeed
from contract.config.tree import Config
from tests.proofs.ecu_in_c.variants import KEY, SPEEDS

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
            frame = replace(frame, data=flipped(frame.data, rng.randrange(8 * len(frame.data))))
        found = secure(frame, spec, _ANOTHER if deed == "forged" else KEY, freshness)
        if deed == "flipped":
            return replace(found, data=flipped(found.data, rng.randrange(8 * len(found.data))))
        if deed == "short":
            return replace(found, data=found.data[: rng.choice((0, 8, 12, 16))])
        return frame if deed == "bare" else found


def flipped(data: bytes, bit: int) -> bytes:
    place = bit // 8
    return data[:place] + bytes([data[place] ^ 1 << bit % 8]) + data[place + 1 :]


class Drive:
    """A vehicle of any speed: its `ratio` to the design speed, and the density of the air in kg/m3."""

    def __init__(self, config: Config, rng: Random) -> None:
        self._rng, self._message, self._settings = rng, message_set(config.bus).speed, config.ecu.speed
        self._design = config.operating_point
        self.ratio, self.density = 1.0, self._design.density
        self._towards, self._stated, self._counter, self._silent, self._old_ns = 1.0, False, 0, 0, 0
        self.sealing = Sealing(config, rng)
        self.speeds = edges(config)

    @property
    def dynamic_pressure(self) -> float:
        return 0.5 * self.density * (self.ratio * self._design.speed) ** 2

    def move(self, odd: float) -> None:
        rng = self._rng
        if rng.random() < 0.03:
            inside = rng.uniform(SPEEDS.slowest, SPEEDS.fastest)
            self._towards = rng.choice((1.0, inside, inside, rng.choice(self.speeds), rng.uniform(0.1, 2.0)))
        reach = 2.0 if rng.random() < 0.02 + odd / 30 else 0.03
        self.ratio += max(-reach, min(reach, self._towards - self.ratio))
        if rng.random() < 0.01:
            self._stated = rng.random() < 0.6
            self.density = rng.uniform(0.9, 1.4) if self._stated else self._design.density
        if rng.random() < 0.01 + odd / 30:
            self._silent = rng.randrange(1, 40)
            self._old_ns = rng.choice((0, 0, 10_000_000, 50_000_000, 60_000_000, 400_000_000))
        self._silent = max(0, self._silent - 1)

    def frame(self, now_ns: int, queued_ns: int, odd: float) -> Frame | None:
        """On the bus in this period; None if there is none."""
        rng, spec = self._rng, self._message.spec
        if self._silent and not self._old_ns:
            return None
        speed = self.ratio * self._design.speed if rng.random() >= 0.02 + odd / 10 else rng.choice((None, 0.0, 300.0))
        age_ns, density = self._old_ns if self._silent else 0, self.density if self._stated else None
        data = self._message.emit(VehicleSpeed(speed_m_per_s=speed, age_ns=age_ns, density_kg_per_m3=density))
        sound = profile_of(spec).protect(data, data_id=spec.data_id, counter=self._counter)
        self._counter = (self._counter + 1) % profile_of(spec).counter_period
        sent_ns = now_ns - queued_ns
        if rng.random() < odd / 5:
            # Of the largest age, or nearly so, or of the future.
            sent_ns = now_ns - rng.choice((0, round(self._settings.oldest_ms * 1e6))) + rng.randrange(-1, 2)
        frame = Frame(frame_id=spec.frame_id, data=sound, is_fd=spec.is_fd)
        return replace(self.sealing.sealed(frame, spec, odd), timestamp_ns=max(0, min(2**63 - 1, sent_ns)))


def edges(config: Config) -> list[float]:
    """Ratios at the ends of the range, without and with the margin, and a step of the wire beside them."""
    design, margin = config.operating_point.speed, config.ecu.speed.margin
    slowest, fastest = SPEEDS.slowest, SPEEDS.fastest
    ends = (slowest, slowest * (1.0 - margin), fastest, fastest * (1.0 + margin))
    steps = [round(end * design / SPEED_RESOLUTION_M_PER_S) + off for end in ends for off in (-1, 0, 1)]
    return [step * SPEED_RESOLUTION_M_PER_S / design for step in steps]
