"""The plant's kernels are compiled before a test runs it; and what a refused command must leave."""

from collections.abc import Callable

import pytest

from wake.truck.truck_wake import TruckWake


@pytest.fixture(scope="session", autouse=True)
def _kernels(shared_wake: TruckWake) -> None:
    """Compiled once."""


@pytest.fixture
def refused(cli, tmp_path) -> Callable[..., str]:
    """Run it, see that it fails as it should and leaves `tmp_path` as it was; return the line."""

    def run(*arguments: object) -> str:
        before = sorted(tmp_path.rglob("*"))
        outcome = cli(*arguments)
        assert outcome.code == 1
        assert outcome.err.startswith("error: ")
        assert outcome.err.count("\n") == 1
        assert "wrote" not in outcome.out
        assert sorted(tmp_path.rglob("*")) == before
        return outcome.err

    return run
