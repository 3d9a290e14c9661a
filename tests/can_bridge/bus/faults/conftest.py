import pytest

from tests.can_bridge.bus.faults.links import Link, simulated_link


@pytest.fixture
def link() -> Link:
    return simulated_link()
