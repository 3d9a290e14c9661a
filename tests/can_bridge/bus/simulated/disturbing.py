"""Buses whose every bit takes equally long, and what went over them."""

from typing import Any

from can_bridge.bus.simulated.medium import SimulatedBus, Transmission
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig

RATES = BusConfig(nominal_bitrate=500_000, data_bitrate=500_000)
"""One length of bit, so that times are counts."""
BIT = 2000
INTERMISSION = 3
SENT = Frame(frame_id=0x155, data=b"\x55" * 4, is_fd=False)


def bus_of(*names: str, config: BusConfig = RATES, **hooks: Any) -> list[Any]:
    """A bus, what went over it, and its nodes."""
    seen: list[Transmission] = []
    bus = SimulatedBus(config, observe=seen.append, **hooks)
    return [bus, seen, *(bus.port(name) for name in names)]


def counts(*ports) -> list[tuple[int, int]]:
    return [(port.health().tx_errors, port.health().rx_errors) for port in ports]
