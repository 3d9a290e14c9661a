"""The plant's kernels are compiled before a test runs it; and what a refused command must leave."""

from collections.abc import Callable, Iterator, Mapping

import can
import pytest

from wake.truck.truck_wake import TruckWake

Words = str | tuple[object, ...]


@pytest.fixture(scope="session", autouse=True)
def _kernels(shared_wake: TruckWake) -> None:
    """Compiled once."""


@pytest.fixture
def printed(cli) -> Callable[..., str]:
    """Run a command that succeeds and has nothing to say on stderr; return what it printed."""

    def run(*arguments: object) -> str:
        outcome = cli(*arguments)
        assert (outcome.code, outcome.err) == (0, ""), arguments
        return str(outcome.out)

    return run


@pytest.fixture
def refused(cli, tmp_path) -> Callable[..., str]:
    """Run it, see that it fails as it should and leaves `tmp_path` as it was; return the line."""

    def run(*arguments: object, status: int = 1) -> str:
        before = sorted(tmp_path.rglob("*"))
        outcome = cli(*arguments)
        assert outcome.code == status, (arguments, outcome)
        assert outcome.err.startswith("error: "), arguments
        assert outcome.err.count("\n") == 1, (arguments, outcome.err)
        assert "wrote" not in outcome.out, arguments
        assert sorted(tmp_path.rglob("*")) == before, arguments
        return outcome.err

    return run


@pytest.fixture
def all_refused(refused, tmp_path, monkeypatch) -> Callable[[Words, Mapping[Words, str]], None]:
    """Call a command in `tmp_path` with each of the words; every line must name what is given with them."""
    monkeypatch.chdir(tmp_path)

    def run(command: Words, cases: Mapping[Words, str]) -> None:
        for words, named in cases.items():
            both = (one for part in (command, words) for one in (part.split() if isinstance(part, str) else part))
            line = refused(*both)
            assert named in line, (words, line)

    return run


@pytest.fixture
def peer() -> Iterator[can.BusABC]:
    """Another node on the virtual bus that the commands of `commands/can` open."""
    with can.Bus(interface="virtual", channel="test-can", protocol=can.CanProtocol.CAN_FD) as bus:
        yield bus
