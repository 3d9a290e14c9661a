"""A bus of python-can inside this process for each test, and a simulated one."""

from collections.abc import Iterator

import pytest

from can_bridge.bus.backends.python_can import PythonCanBus
from contract.config.vehicle import BusConfig
from tests.can_bridge.bus.faults.links import Link, simulated_link


@pytest.fixture
def config(request: pytest.FixtureRequest) -> BusConfig:
    """A virtual bus that no other test uses."""
    return BusConfig(interface="virtual", channel=request.node.name)


@pytest.fixture
def pair(config: BusConfig) -> Iterator[tuple[PythonCanBus, PythonCanBus]]:
    with PythonCanBus.open(config) as one, PythonCanBus.open(config) as other:
        yield one, other


@pytest.fixture
def link() -> Link:
    return simulated_link()
