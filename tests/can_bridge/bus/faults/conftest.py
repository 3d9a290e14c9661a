"""Links to try faults on."""

from collections.abc import Callable, Iterator
from itertools import count

import pytest

from can_bridge.bus.backends.python_can import PythonCanBus
from contract.config.vehicle import BusConfig
from tests.can_bridge.bus.faults.links import Link, simulated_link

CHANNELS = count()


@pytest.fixture
def simulated() -> Link:
    return simulated_link()


@pytest.fixture
def virtual() -> Iterator[Link]:
    config = BusConfig(interface="virtual", channel=f"faults-{next(CHANNELS)}")
    with (
        PythonCanBus.open(config) as one,
        PythonCanBus.open(config) as other,
        PythonCanBus.open(config) as listener,
    ):
        yield Link([one, other, listener])


@pytest.fixture(params=["simulated", "virtual"])
def link(request) -> Link:
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def link_of() -> Callable[[], Link]:
    """For property tests, which want one an example."""
    return simulated_link
