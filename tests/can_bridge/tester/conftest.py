import pytest

from tests.can_bridge.tester.line import Line, VirtualTime
from tests.can_bridge.tester.played_ecu import Played, PlayedEcu, played


@pytest.fixture
def kept() -> Played:
    return played()


@pytest.fixture
def line(kept: Played) -> Line:
    return Line(PlayedEcu(kept))


@pytest.fixture
def time(line: Line) -> VirtualTime:
    return line.time
