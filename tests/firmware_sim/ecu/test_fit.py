"""A release is refused by name where it was made for another flow or vehicle. Its horizon here is 5."""

import pytest

from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.errors import BundleError
from contract.operating_point import OperatingPoint
from firmware_sim.ecu.ecu import Ecu
from firmware_sim.ecu.fit import check_flow, check_vehicle


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"control_period": 0.1}, r"'small' was built for another control period: 0\.1, the flow has 0\.2"),
        ({"action_limit": 0.05}, r"'small' was built for another action limit: 0\.05, the flow has 0\.075"),
    ],
)
def test_a_bundle_for_another_flow_is_refused(bundle_of, changes, named):
    check_flow(bundle_of(), FlowConfig())
    with pytest.raises(BundleError, match=named):
        check_flow(bundle_of(**changes), FlowConfig())


@pytest.mark.parametrize(
    ("bundle_changes", "config", "named"),
    [
        ({"operating_point": OperatingPoint(speed=20.0)}, Config(), "operating point.*20.0.*25.0"),
        ({"control_period": 0.1}, Config(), "control period: 0.1, the vehicle has 0.2"),
        ({"action_limit": 0.05}, Config(), "action limit: 0.05"),
        ({"sensors": ("base_0", "base_1")}, Config(), "2 sensors: the Pressure message carries 4"),
        ({}, Config(ecu=EcuConfig(delay_steps=5)), "delay_steps = 5: must be below the horizon 5"),
    ],
)
def test_a_bundle_for_another_vehicle_is_refused(bundle_of, recording_controller, bundle_changes, config, named):
    check_vehicle(bundle_of(), Config())
    with pytest.raises(BundleError, match=named):
        check_vehicle(bundle_of(**bundle_changes), config)
    with pytest.raises(BundleError, match=named):
        Ecu(bundle_of(**bundle_changes), recording_controller(), config)
