"""Links to try faults on."""

from collections.abc import Iterator
from itertools import count

import pytest

from can_bridge.bus.backends.python_can import PythonCanBus
from contract.config.vehicle import BusConfig
from tests.can_bridge.bus.faults.links import Link, simulated_link

CHANNELS = count()


@pytest.fixture
def link() -> Link:
    return simulated_link()


@pytest.fixture
def virtual() -> Iterator[Link]:
    """Over python-can's bus in this process."""
    config = BusConfig(interface="virtual", channel=f"faults-{next(CHANNELS)}")
    with (
        PythonCanBus.open(config) as one,
        PythonCanBus.open(config) as other,
        PythonCanBus.open(config) as listener,
    ):
        yield Link([one, other, listener])
