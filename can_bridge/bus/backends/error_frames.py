"""Error frames of SocketCAN: what a CAN controller reports about itself (`linux/can/error.h`).

The identifier holds the classes of the error; data bytes 1, 6 and 7 hold the controller's state and its counters.
"""

from dataclasses import replace
from typing import Final

from can_bridge.bus.interface import BusHealth, BusState

CONTROLLER: Final = 0x004
"""CAN_ERR_CRTL: the state is in data byte 1."""
BUS_OFF: Final = 0x040
"""CAN_ERR_BUSOFF."""
RESTARTED: Final = 0x100
"""CAN_ERR_RESTARTED: back from bus-off."""
COUNTERS: Final = 0x200
"""CAN_ERR_CNT: data bytes 6 and 7 hold the transmit and receive error counters. Kernels before 6.0 do not set it."""

RX_OVERFLOW: Final = 0x01
"""CAN_ERR_CRTL_RX_OVERFLOW, in data byte 1 like the next two."""
PASSIVE: Final = 0x10 | 0x20
"""CAN_ERR_CRTL_RX_PASSIVE and TX_PASSIVE."""
ACTIVE: Final = 0x40
"""CAN_ERR_CRTL_ACTIVE: recovered from error-passive."""

LENGTH: Final = 8
"""CAN_ERR_DLC."""


def health_after(health: BusHealth, classes: int, data: bytes) -> BusHealth:
    """What is known of the controller after one error frame.

    Args:
        classes: the frame's identifier without its flags.
        data: its eight bytes; another length is ignored.
    """
    if len(data) != LENGTH:
        return health
    controller = data[1] if classes & CONTROLLER else 0
    # Older kernels leave the bytes zero where a driver does not know the counters.
    if classes & COUNTERS or (classes & CONTROLLER and any(data[6:8])):
        health = replace(health, tx_errors=data[6], rx_errors=data[7])
    if classes & BUS_OFF:
        return replace(health, state=BusState.BUS_OFF, bus_off=health.bus_off + 1)
    if classes & RESTARTED:
        # A controller leaves bus-off error-active with both counters at zero (ISO 11898-1, fault confinement).
        return replace(health, state=BusState.ERROR_ACTIVE, tx_errors=0, rx_errors=0)
    if health.state is BusState.BUS_OFF:
        return health
    if controller & PASSIVE:
        return replace(health, state=BusState.ERROR_PASSIVE)
    if controller & ACTIVE:
        return replace(health, state=BusState.ERROR_ACTIVE)
    return health


def lost_frames(classes: int, data: bytes) -> bool:
    """Whether the controller reports that it dropped received frames."""
    return len(data) == LENGTH and bool(classes & CONTROLLER and data[1] & RX_OVERFLOW)
