"""The background traffic of other nodes on a simulated bus: periodic messages, generated or from a DBC file.

The share of the bus that generated messages fill is computed from the longest frame of each message. A background of
0.9 therefore leaves at least a tenth of the bus free, so that no queue grows without bound. Random contents need fewer
stuff bits, so the measured load of the bus is about 15 per cent smaller than the share.
"""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Final

from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.bus.simulated.port import SimulatedPort
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, Frame, Priority, priority
from can_bridge.wire.frame_bits import worst_case_ns
from can_bridge.wire.message_specs import SPECS
from can_bridge.wire.network_file import load_network
from contract.config.vehicle import BusConfig
from contract.errors import BusError, ConfigError

if TYPE_CHECKING:
    from cantools.database.can.database import Database
    from cantools.database.can.message import Message

NS_PER_MS: Final = 10**6

OUR_IDS: Final = frozenset(spec.frame_id for spec in SPECS)
"""Identifiers of our messages in all message sets, used or not. Messages of other nodes must not have them."""


@dataclass(frozen=True, kw_only=True)
class PeriodicMessage:
    """A periodic message of a node. The node begins to prepare one frame at each release.

    Attributes:
        period_ns: shortest time between two releases.
        offset_ns: time of the first release.
        jitter_ns: largest delay from a release until the frame is queued.
        deadline_ns: time after a release by which the frame has to arrive; 0 means the period.
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

    @property
    def priority(self) -> Priority:
        return priority(self.frame(bytes(self.length)))

    def frame(self, data: bytes) -> Frame:
        """Return a frame of the message; `data` must have `length` bytes."""
        return Frame(frame_id=self.frame_id, data=data, is_fd=self.is_fd, is_extended=self.is_extended)

    def worst_ns(self, bus: BusConfig) -> int:
        """Return the longest time in ns for which a frame of the message occupies the bus."""
        frame = self.frame(bytes(self.length))
        return worst_case_ns(frame, nominal_bitrate=bus.nominal_bitrate, data_bitrate=bus.data_bitrate)


@dataclass(frozen=True, kw_only=True)
class BackgroundTraffic:
    """The messages of other nodes, highest priority first. `left_out` names each message that is not sent, and why."""

    messages: tuple[PeriodicMessage, ...]
    left_out: tuple[str, ...] = ()


def read_traffic(path: Path, bus: BusConfig, *, seed: int) -> BackgroundTraffic:
    """Return a file's messages at their cycle times (`GenMsgCycleTime` in a DBC), with random phases from `seed`.

    A message is left out if it has no cycle time, is longer than a frame, is CAN FD without bit-rate switching, or is
    one of stillwake's messages. Raises BusError as `load_network` does, or if no message is left, two messages have the
    same identifier, one has an identifier of stillwake, or one is CAN FD on a classic bus.
    """
    database = load_network(path)
    random = Random(seed)
    messages: list[PeriodicMessage] = []
    left_out: list[str] = []
    for message in database.messages:
        why = _why_not(message, database)
        if why is not None:
            left_out.append(f"{message.name} ({why})")
            continue
        assert message.cycle_time is not None  # a message without a cycle time is left out
        _check(path, message, bus)
        period_ns = round(message.cycle_time * NS_PER_MS)
        lengths = FD_LENGTHS if message.is_fd else CLASSIC_LENGTHS
        messages.append(
            PeriodicMessage(
                name=message.name,
                frame_id=message.frame_id,
                is_extended=message.is_extended_frame,
                is_fd=message.is_fd,
                length=next(length for length in lengths if length >= message.length),
                period_ns=period_ns,
                offset_ns=random.randrange(period_ns),
            )
        )
    if not messages:
        raise BusError(f"{path}: no message to send: {'; '.join(left_out[:3]) or 'it has no messages'}")
    messages.sort(key=lambda message: message.priority)
    for one, other in pairwise(messages):
        if one.priority == other.priority:
            raise BusError(f"{path}: {one.name} and {other.name} have the same identifier, {one.frame_id:#x}")
    return BackgroundTraffic(messages=tuple(messages), left_out=tuple(left_out))


def _why_not(message: "Message", database: "Database") -> str | None:
    if (message.name, message.frame_id) in ((spec.name, spec.frame_id) for spec in SPECS):
        return "stillwake's own"
    if not message.cycle_time or round(message.cycle_time * NS_PER_MS) <= 0:
        return "no cycle time"
    if message.length > (FD_LENGTHS if message.is_fd else CLASSIC_LENGTHS)[-1]:
        return f"{message.length} bytes are more than a frame"
    if message.is_fd and not _switches_rate(message, database):
        return "CAN FD without bit-rate switching"
    return None


def _switches_rate(message: "Message", database: "Database") -> bool:
    if message.dbc is None or database.dbc is None:
        return True
    given = message.dbc.attributes.get("CANFD_BRS")
    definition = database.dbc.attribute_definitions.get("CANFD_BRS")
    value = given.value if given is not None else None if definition is None else definition.default_value
    return value is None or str(value) in ("1", "")


def _check(path: Path, message: "Message", bus: BusConfig) -> None:
    if not message.is_extended_frame and message.frame_id in OUR_IDS:
        raise BusError(
            f"{path}: {message.name} has identifier {message.frame_id:#x}, which belongs to stillwake: two nodes "
            "must not send the same identifier"
        )
    if message.is_fd and bus.frames == "classic":
        raise BusError(f"{path}: {message.name} is CAN FD, which a bus with bus.frames = classic cannot carry")


PERIODS_MS: Final = (5, 10, 20, 50, 100, 200, 500, 1000)
_PERIOD_WEIGHTS: Final = (1, 6, 6, 3, 8, 3, 2, 3)
"""Periods in ms of generated messages, and their weights as in published benchmarks of body and powertrain buses."""
_CLASSIC_LENGTHS: Final = (8, 8, 8, 8, 6, 4, 2)
_FD_LENGTHS: Final = (8, 8, 16, 24, 32, 48, 64, 64)


def background(bus: BusConfig) -> BackgroundTraffic:
    """Return the configured traffic of other nodes. Raises the errors of `read_traffic` and `made_up`."""
    config = bus.background
    if config.dbc:
        return read_traffic(Path(config.dbc), bus, seed=config.seed)
    return BackgroundTraffic(messages=made_up(config.load, bus, seed=config.seed) if config.load else ())


def made_up(load: float, bus: BusConfig, *, seed: int) -> tuple[PeriodicMessage, ...]:
    """Return messages that fill the share `load` of the bus with their longest frames, until the next random message
    does not fit. Messages with shorter periods have higher priorities. If there are two or more, the first has a higher
    priority than all our messages, and the last has a lower priority. Raises ConfigError if no message fits."""
    random = Random(seed)
    drawn = sorted(_draw(load, bus, random))
    if not drawn:
        raise ConfigError(f"bus.background.load = {load}: too small for one message per second")
    return tuple(
        PeriodicMessage(
            name=f"Background{frame_id:03X}",
            frame_id=frame_id,
            is_fd=bus.frames == "fd",
            length=length,
            period_ns=period_ns,
            offset_ns=random.randrange(period_ns),
        )
        for frame_id, (period_ns, length) in zip(_identifiers(len(drawn), random), drawn, strict=True)
    )


def _draw(load: float, bus: BusConfig, random: Random) -> Iterator[tuple[int, int]]:
    """Yield period in ns and length in bytes of each message, until the next message would exceed the share."""
    lengths = _CLASSIC_LENGTHS if bus.frames == "classic" else _FD_LENGTHS
    left = load
    while True:
        length = random.choice(lengths)
        (asked,) = random.choices(PERIODS_MS, _PERIOD_WEIGHTS)
        probe = PeriodicMessage(name="", frame_id=0, is_fd=bus.frames == "fd", length=length, period_ns=1)
        busy_ns = probe.worst_ns(bus)
        # A message with a longer period than the random period may still fit into the remaining share.
        periods = (ms * NS_PER_MS for ms in PERIODS_MS if ms >= asked)
        period_ns = next((period for period in periods if busy_ns <= left * period), None)
        if period_ns is None:
            return
        left -= busy_ns / period_ns
        yield period_ns, length


def _identifiers(count: int, random: Random) -> list[int]:
    """Return `count` free identifiers in rising order. There are enough for all loads and bit rates."""
    # Smaller numbers are for network management, larger numbers for diagnostics.
    free = [frame_id for frame_id in range(0x010, 0x700) if frame_id not in OUR_IDS]
    above = [frame_id for frame_id in free if frame_id < min(OUR_IDS)]
    below = [frame_id for frame_id in free if frame_id > max(OUR_IDS)]
    fixed = [random.choice(part) for part in (above, below)] if count > 1 else []
    rest = sorted(set(free) - set(fixed))
    return sorted([*fixed, *random.sample(rest, count - len(fixed))])


def send_background(
    bus: SimulatedBus, port: SimulatedPort, messages: Iterable[PeriodicMessage], seed: int, *, drift_ppm: float = 200
) -> None:
    """Let a node of the simulated bus send periodic messages with random contents. Each message starts at its offset
    from now, and is late by at most its jitter. Each message has a separate clock, as if a separate node sent it, so
    that its phase relative to the control loop changes during a run. `SimulatedPort.refused` counts refused frames.

    Args:
        seed: random seed of contents, jitter and clocks. Each message has an independent random sequence.
        drift_ppm: largest drift of the clocks; 200 for two quartz clocks whose errors are 100 ppm each. A clock is
            slower than the bus's time by a drift between 0 and this value. No clock is faster, because the
            response-time analysis assumes that no period is shorter than stated.
    """

    def plan(message: PeriodicMessage, random: Random, period_ns: int, due_ns: int) -> None:
        late_ns = random.randint(0, message.jitter_ns)
        bus.call_at(due_ns + late_ns, partial(send, message, random))
        next_ns = due_ns + period_ns
        bus.call_at(next_ns, partial(plan, message, random, period_ns, next_ns))

    def send(message: PeriodicMessage, random: Random) -> None:
        with suppress(BusError):
            port.send(message.frame(random.randbytes(message.length)))

    for message in messages:
        random = Random(f"{seed} {message.is_extended} {message.frame_id}")
        period_ns = message.period_ns + round(message.period_ns * random.uniform(0.0, drift_ppm) * 1e-6)
        plan(message, random, period_ns, bus.now_ns + message.offset_ns)
