"""The background traffic that other nodes put on the bus: made up, or that of a DBC file.

Made-up messages fill a share of the bus at their worst-case frame length, whatever they contain: a background of 0.9
leaves a tenth of the bus free in every case, and no queue grows without end. Random contents need fewer stuff bits, so
a meter on the bus shows about 15 per cent less than the share.
"""

from collections.abc import Collection, Iterator
from pathlib import Path
from random import Random
from typing import Final

from can_bridge.timing.dbc_traffic import Traffic, read_traffic
from can_bridge.timing.periodic_message import NS_PER_MS, OUR_IDS, PeriodicMessage
from contract.config.vehicle import BackgroundConfig, BusConfig
from contract.errors import ConfigError

PERIODS_MS: Final = (5, 10, 20, 50, 100, 200, 500, 1000)
"""Periods of made-up messages: the usual ones in vehicles."""
_PERIOD_WEIGHTS: Final = (1, 6, 6, 3, 8, 3, 2, 3)
"""How often each is drawn: mostly 10, 20 and 100 ms, as in the body and powertrain sets published for benchmarks."""
_CLASSIC_LENGTHS: Final = (8, 8, 8, 8, 6, 4, 2)
_FD_LENGTHS: Final = (8, 8, 16, 24, 32, 48, 64, 64)
_IDS: Final = range(0x010, 0x700)
"""Identifiers of made-up messages: below lies network management of high priority, above diagnostics."""


def background(config: BackgroundConfig, bus: BusConfig, taken: Collection[int]) -> Traffic:
    """What other nodes send; nothing where no background is set. Raises ConfigError for a share that no set of messages
    fills; BusError for a file that cannot be read, or that does not go with this bus.

    Args:
        bus: the bit rates, and whether CAN FD is spoken.
        taken: 11-bit identifiers that are in use already, besides ours.
    """
    if config.dbc:
        return read_traffic(Path(config.dbc), bus, taken, seed=config.seed)
    return Traffic(messages=made_up(config.load, bus, taken, seed=config.seed) if config.load else ())


def made_up(load: float, bus: BusConfig, taken: Collection[int], *, seed: int) -> tuple[PeriodicMessage, ...]:
    """Messages that take the share `load` of the bus at their worst-case length, short of it by one rare message.

    Shorter periods have higher priorities, as designers assign them. With two messages or more, the first is above all
    taken identifiers in priority and the last below them, where there is room. Raises ConfigError if the share is less
    than one message takes, or more than all identifiers can fill.
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
