"""The plant's kernels are compiled before a test runs it."""

from math import cos

import pytest

from contract.config.tree import Config
from contract.config.vehicle import BusConfig, EcuConfig
from tests.firmware_sim.bench.harness import Harness
from wake.truck.truck_wake import TruckWake


@pytest.fixture(scope="session", autouse=True)
def _kernels(shared_wake: TruckWake) -> None:
    """Compiled once."""


@pytest.fixture
def harness(bundle_of, recording_controller):
    def make(
        compute_ms: float,
        *,
        vehicle=lambda port: port,
        ecu=lambda port: port,
        controller=None,
        bus=None,
        corrupts=None,
        plan_ahead=False,
        **ecu_settings,
    ):
        config = Config(
            bus=bus or BusConfig(), ecu=EcuConfig(compute_time_ms=compute_ms, plan_ahead=plan_ahead, **ecu_settings)
        )
        step = iter(range(10**6))
        default = recording_controller(lambda i: 0.03 * cos(next(step)))
        return Harness(bundle_of(), config, controller or default, {"vehicle": vehicle, "ecu": ecu}, corrupts)

    return make
