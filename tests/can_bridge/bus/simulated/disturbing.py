"""Buses with a disturbance that is written down, and what it takes to count its bits."""

from collections.abc import Callable
from typing import Any

from can_bridge.bus.simulated.medium import SimulatedBus, Transmission
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import sent_bits
from contract.config.vehicle import BusConfig

RATES = BusConfig(nominal_bitrate=500_000, data_bitrate=500_000)
"""One length of bit, so that times are counts."""
BIT = 2000
FLAGS, FLAG, DELIMITER, INTERMISSION, SUSPEND = 12, 6, 8, 3, 8
SENT = Frame(frame_id=0x155, data=b"\x55" * 4, is_fd=False)
LENGTH = sent_bits(SENT).total[0]
TO_ACKNOWLEDGE = LENGTH - INTERMISSION - 7 - 1
"""Bits up to and including the acknowledge slot."""


def bits(ns: int) -> int:
    assert ns % BIT == 0
    return ns // BIT


def script(*positions: int, only: str = "") -> Callable[[Frame, str, int], int | None]:
    """A disturbance of the first so many attempts, of those of one node if it is named."""
    left = list(positions)
    return lambda frame, name, begin_ns: left.pop(0) if left and only in ("", name) else None


def bus_of(*names: str, config: BusConfig = RATES, **hooks: Any) -> list[Any]:
    """A bus, what went over it, and its nodes."""
    seen: list[Transmission] = []
    bus = SimulatedBus(config, observe=seen.append, **hooks)
    return [bus, seen, *(bus.port(name) for name in names)]


def counts(*ports) -> list[tuple[int, int]]:
    return [(port.health().tx_errors, port.health().rx_errors) for port in ports]
