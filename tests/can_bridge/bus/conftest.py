"""A bus of python-can inside this process for each test, and a simulated one."""

from collections.abc import Iterator
from itertools import count

import pytest

from can_bridge.bus.backends.python_can import PythonCanBus
from contract.config.vehicle import BusConfig
from tests.can_bridge.bus.faults.links import Link, simulated_link

CHANNELS = count()


@pytest.fixture
def config() -> BusConfig:
    """A virtual bus that no other test uses."""
    return BusConfig(interface="virtual", channel=f"test-{next(CHANNELS)}")


@pytest.fixture
def pair(config: BusConfig) -> Iterator[tuple[PythonCanBus, PythonCanBus]]:
    with PythonCanBus.open(config) as one, PythonCanBus.open(config) as other:
        yield one, other


@pytest.fixture
def link() -> Link:
    return simulated_link()
