"""One plant for the room's tests: building it takes longer than most of them."""

import pytest

from wake.truck_wake import TruckWake, developed_state


@pytest.fixture(scope="session")
def shared_wake() -> TruckWake:
    return TruckWake()


@pytest.fixture
def wake(shared_wake: TruckWake) -> TruckWake:
    """The plant in its shipped developed state."""
    shared_wake.reset(developed_state())
    return shared_wake
