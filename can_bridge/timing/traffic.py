"""Periodic messages, and the background traffic that other nodes put on the bus: made up, or those of a DBC file.

Made-up messages fill a share of the bus at their worst-case frame length, whatever they contain: a background of 0.9
leaves a tenth of the bus free in every case, and no queue grows without end. Random contents need fewer stuff bits, so
a meter on the bus shows about 15 per cent less than the share.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Final

from can_bridge.bus.simulated.transmit_queue import Priority, priority
from can_bridge.wire.bit_timing import worst_case_ns
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import SPECS
from contract.config.vehicle import BackgroundConfig, BusConfig
from contract.errors import ConfigError

NS_PER_MS: Final = 10**6

PERIODS_MS: Final = (5, 10, 20, 50, 100, 200, 500, 1000)
"""Of made-up messages: the usual ones in vehicles."""
_PERIOD_WEIGHTS: Final = (1, 6, 6, 3, 8, 3, 2, 3)
"""How often each is drawn: mostly 10, 20 and 100 ms, as in the body and powertrain sets published for benchmarks."""
_CLASSIC_LENGTHS: Final = (8, 8, 8, 8, 6, 4, 2)
_FD_LENGTHS: Final = (8, 8, 16, 24, 32, 48, 64, 64)
_IDS: Final = range(0x010, 0x700)
"""Of made-up messages: below lies network management of high priority, above diagnostics."""
OUR_IDS: Final = frozenset(spec.frame_id for spec in SPECS)
"""Of all sets, also those not in use: other nodes never have them."""


@dataclass(frozen=True, kw_only=True)
class PeriodicMessage:
    """A message that a node sends again and again.

    Attributes:
        frame_id: of 11 bits, or 29 if it is extended.
        length: bytes of data.
        period_ns: time between two releases, at least.
        offset_ns: of the first one.
        jitter_ns: most by which the node queues a frame late.
        deadline_ns: after its release a frame has to have arrived; 0 stands for the period.

    Raises:
        ValueError: for a frame that no controller could send, or a time that makes no sense.
    """

    name: str
    frame_id: int
    is_extended: bool = False
    is_fd: bool
    length: int
    period_ns: int
    offset_ns: int = 0
    jitter_ns: int = 0
    deadline_ns: int = 0

    def __post_init__(self) -> None:
        self.frame(bytes(self.length))
        if self.period_ns <= 0:
            raise ValueError(f"{self.name}: period {self.period_ns} ns: must be positive")
        for what in ("offset", "jitter", "deadline"):
            value = getattr(self, f"{what}_ns")
            if value < 0:
                raise ValueError(f"{self.name}: {what} {value} ns: must not be negative")

    @property
    def priority(self) -> Priority:
        """The smaller wins arbitration."""
        return priority(self.frame(bytes(self.length)))

    def frame(self, data: bytes) -> Frame:
        """One frame of it, `length` bytes long."""
        return Frame(frame_id=self.frame_id, data=data, is_fd=self.is_fd, is_extended=self.is_extended)

    def worst_ns(self, bus: BusConfig) -> int:
        """How long its frame occupies the bus at worst."""
        return worst_case_ns(
            self.frame(bytes(self.length)), nominal_bitrate=bus.nominal_bitrate, data_bitrate=bus.data_bitrate
        )


def background(config: BackgroundConfig, bus: BusConfig, taken: Collection[int]) -> tuple[PeriodicMessage, ...]:
    """What other nodes send, the highest priority first; empty where no background is set.

    Args:
        config: a share of the bus, or a file.
        bus: the bit rates, and whether CAN FD is spoken.
        taken: 11-bit identifiers that are in use already, besides ours.

    Raises:
        ConfigError: a share that no set of messages fills.
        BusError: a file that cannot be read, or that does not go with this bus.
    """
    if config.dbc:
        from can_bridge.timing.dbc_traffic import read_traffic

        return read_traffic(Path(config.dbc), bus, taken, seed=config.seed).messages
    return made_up(config.load, bus, taken, seed=config.seed) if config.load else ()


def made_up(load: float, bus: BusConfig, taken: Collection[int], *, seed: int) -> tuple[PeriodicMessage, ...]:
    """Messages that take the share `load` of the bus at their worst-case length, short of it by one rare message.

    Shorter periods have higher priorities, as designers assign them. With two messages or more, the first is above all
    taken identifiers in priority and the last below them, where there is room.

    Raises:
        ConfigError: the share is less than one message takes, or more than all identifiers can fill.
    """
    random = Random(seed)
    drawn = sorted(_draw(load, bus, random))
    if not drawn:
        raise ConfigError(f"bus.background.load = {load}: less than one message a second takes at these bit rates")
    ids = _identifiers(len(drawn), taken, random)
    if len(ids) < len(drawn):
        raise ConfigError(
            f"bus.background.load = {load}: needs more than the {len(ids)} free identifiers at these bit rates"
        )
    return tuple(
        PeriodicMessage(
            name=f"Background{frame_id:03X}",
            frame_id=frame_id,
            is_fd=bus.frames == "fd",
            length=length,
            period_ns=period_ns,
            offset_ns=random.randrange(period_ns),
        )
        for frame_id, (period_ns, length) in zip(ids, drawn, strict=True)
    )


def _draw(load: float, bus: BusConfig, random: Random) -> Iterator[tuple[int, int]]:
    """Periods in ns and lengths, until the next would exceed the share; at most one more than there are identifiers."""
    lengths = _CLASSIC_LENGTHS if bus.frames == "classic" else _FD_LENGTHS
    left = load
    for _ in range(len(_IDS) + 1):
        length = random.choice(lengths)
        (asked,) = random.choices(PERIODS_MS, _PERIOD_WEIGHTS)
        probe = PeriodicMessage(name="", frame_id=0, is_fd=bus.frames == "fd", length=length, period_ns=1)
        busy_ns = probe.worst_ns(bus)
        # The rest of the share is filled with rarer messages.
        periods = (ms * NS_PER_MS for ms in PERIODS_MS if ms >= asked)
        period_ns = next((period for period in periods if busy_ns <= left * period), None)
        if period_ns is None:
            return
        left -= busy_ns / period_ns
        yield period_ns, length


def _identifiers(count: int, taken: Collection[int], random: Random) -> list[int]:
    """So many free identifiers in rising order, or all there are."""
    taken = {*taken, *OUR_IDS}
    free = [frame_id for frame_id in _IDS if frame_id not in taken]
    if count >= len(free):
        return free
    above = [frame_id for frame_id in free if frame_id < min(taken)]
    below = [frame_id for frame_id in free if frame_id > max(taken)]
    fixed = [random.choice(part) for part in (above, below) if part] if count > 1 else []
    rest = sorted(set(free) - set(fixed))
    return sorted([*fixed, *random.sample(rest, count - len(fixed))])
