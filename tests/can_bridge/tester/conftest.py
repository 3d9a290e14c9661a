import pytest

from tests.can_bridge.tester.ecu_to_flash import EcuToFlash
from tests.can_bridge.tester.line import Line


@pytest.fixture
def ecu() -> EcuToFlash:
    return EcuToFlash()


@pytest.fixture
def line(ecu: EcuToFlash) -> Line:
    return Line(ecu)
