"""The plant's kernels are compiled before a test runs it."""

import pytest

from wake.truck.truck_wake import TruckWake


@pytest.fixture(scope="session", autouse=True)
def _kernels(shared_wake: TruckWake) -> None:
    """Compiled once."""
