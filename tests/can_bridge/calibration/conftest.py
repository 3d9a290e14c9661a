"""A release's calibration on a vehicle with limits, and a tool's key."""

from dataclasses import replace
from itertools import count
from typing import Any

import pytest

from can_bridge.calibration.segment import Segment
from can_bridge.calibration.xcp_slave import XcpSlave
from can_bridge.uds.security import AccessKey
from contract.config.controller import CostWeights
from contract.controller.calibration import Calibration, CalibrationLimits
from contract.controller.interface import TERMS
from tests.can_bridge.flashing.store_ecu import KEY

REFERENCE = Calibration(
    weights=CostWeights(drag_mean=1.0, drag_fluctuation=0.1, lift=0.01, smoothness=8.0),
    action_limit=0.075,
    command_step=0.0375,
    delay_steps=1,
)
LIMITS = CalibrationLimits(
    least=Calibration(weights=CostWeights(**dict.fromkeys(TERMS, 0.0)), action_limit=0, command_step=0, delay_steps=0),
    greatest=Calibration(
        weights=CostWeights(**dict.fromkeys(TERMS, 1000.0)), action_limit=0.075, command_step=0.0375, delay_steps=6
    ),
)


def changed(**values: Any) -> Calibration:
    """The reference with other values; weights by their names."""
    weights = {name: values.pop(name) for name in TERMS if name in values}
    return replace(REFERENCE, weights=replace(REFERENCE.weights, **weights), **values)


@pytest.fixture
def segment() -> Segment:
    return Segment(REFERENCE, LIMITS)


@pytest.fixture
def access() -> AccessKey:
    return KEY


@pytest.fixture
def slave(segment, access) -> XcpSlave:
    seeds = count(1)
    return XcpSlave(segment, access, lambda length: bytes([next(seeds)] * length), period_ns=20_000_000)
