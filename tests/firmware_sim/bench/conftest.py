"""The plant's kernels are compiled before a test runs it."""

import pytest


@pytest.fixture(scope="session", autouse=True)
def _kernels(shared_wake) -> None:
    """Compiled once."""
