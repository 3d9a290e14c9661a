"""A release's calibration on a vehicle with limits."""

import pytest

from can_bridge.calibration.segment import Segment
from can_bridge.calibration.xcp_slave import XcpSlave
from contract.controller.calibration import CALIBRATION_NAMES, Calibration, CalibrationLimits
from tests.can_bridge.flashing.store_ecu import KEY, counted

REFERENCE = Calibration.of((1.0, 0.1, 0.01, 0.0, 8.0, 0.0, 0.0, 0.0, 0.075, 0.0375, 1))
LIMITS = CalibrationLimits(
    least=Calibration.of([0.0] * 11), greatest=Calibration.of([1000.0] * 8 + [0.075, 0.0375, 6.0])
)


def changed(**values: float) -> Calibration:
    return Calibration.of(
        [values.get(name, own) for name, own in zip(CALIBRATION_NAMES, REFERENCE.values, strict=True)]
    )


@pytest.fixture
def segment() -> Segment:
    return Segment(REFERENCE, LIMITS)


@pytest.fixture
def slave(segment) -> XcpSlave:
    return XcpSlave(segment, KEY.answer, counted(), period_ns=20_000_000)
