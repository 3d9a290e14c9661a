"""Buses with a disturbance that is written down, and what it takes to count its bits."""

from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import frame_bits
from contract.config.vehicle import BusConfig

RATES = BusConfig(nominal_bitrate=500_000, data_bitrate=500_000)
"""One length of bit, so that times are counts."""
BIT = 2000
FLAGS, FLAG, DELIMITER, INTERMISSION, SUSPEND = 12, 6, 8, 3, 8
SENT = Frame(frame_id=0x155, data=b"\x55" * 4, is_fd=False)
LENGTH = frame_bits(SENT)[0]
TO_ACKNOWLEDGE = LENGTH - INTERMISSION - 7 - 1
"""Bits up to and including the acknowledge slot."""


def bits(ns: int) -> int:
    assert ns % BIT == 0
    return ns // BIT


class Script:
    """A disturbance of the first so many attempts."""

    def __init__(self, *positions: int | None, repeat: bool = False, only: str | None = None) -> None:
        self.positions, self.repeat, self.only, self.calls = list(positions), repeat, only, 0

    def __call__(self, frame: Frame, name: str, begin_ns: int) -> int | None:
        if self.only not in (None, name):
            return None
        self.calls += 1
        if self.repeat:
            return self.positions[0]
        return self.positions.pop(0) if self.positions else None


def two(**hooks):
    bus = SimulatedBus(RATES, **hooks)
    return bus, bus.port("sender"), bus.port("receiver")


def bus_with(seen, **hooks) -> SimulatedBus:
    return SimulatedBus(RATES, observe=seen.append, **hooks)


def counts(*ports) -> list[tuple[int, int]]:
    return [(port.health().tx_errors, port.health().rx_errors) for port in ports]
