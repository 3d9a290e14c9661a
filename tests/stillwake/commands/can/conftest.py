"""Another node on the bus that the commands open."""

from collections.abc import Iterator

import can
import pytest


@pytest.fixture
def peer() -> Iterator[can.BusABC]:
    """Another node on the same bus."""
    with can.Bus(interface="virtual", channel="test-can", protocol=can.CanProtocol.CAN_FD) as bus:
        yield bus
