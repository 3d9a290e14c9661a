"""A release is refused by name where it was made for another flow or vehicle. Its horizon here is 5."""

import numpy as np
import pytest

from contract.config.body import BodyConfig, layout_of
from contract.config.operating_point import OperatingPoint
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.errors import BundleError
from contract.sensors import COUNT, TRUCK
from ecu.bundle_policy import BundlePolicy
from ecu.ecu import Ecu
from ecu.fit import check_flow, check_sensors, check_vehicle
from tests.each import each
from tests.ecu.conftest import RecordingController, make_bundle


@each(
    "changes, ecu, named",
    [
        ({"operating_point": OperatingPoint(speed=20.0)}, {}, "operating point.*20.0.*but.*25.0"),
        ({"control_period": 0.1}, {}, r"'small' was built for control period 0\.1, but the \w+ has 0\.2"),
        ({"action_limit": 0.05}, {}, r"'small' was built for action limit 0\.05, but the \w+ has 0\.075"),
        ({"sensors": ("base_0", "base_1")}, {}, "2 sensors: the Pressure message carries 4"),
        ({}, {"delay_steps": 5}, "delay_steps = 5: must be at most 3 for the horizon of 5, as ecu.plan_ahead is set"),
        ({}, {"delay_steps": 5, "plan_ahead": False}, "delay_steps = 5: must be at most 4 for the horizon of 5$"),
    ],
)
def test_a_bundle_for_another_vehicle_or_flow_is_refused(changes, ecu, named):
    check_vehicle(make_bundle(), Config())
    check_flow(make_bundle(), FlowConfig())
    bundle, config = make_bundle(**changes), Config(ecu=EcuConfig(**ecu))
    refusals = [lambda: check_vehicle(bundle, config), lambda: Ecu(bundle, RecordingController(), config)]
    if "control_period" in changes or "action_limit" in changes:
        refusals.append(lambda: check_flow(bundle, FlowConfig()))
    for refuse in refusals:
        with pytest.raises(BundleError, match=named):
            refuse()


SHORTER = layout_of(BodyConfig(length=5.0))
"""Names of the sensors as the truck's, places on another body: base_0 lies at x = 5, on the truck at 7.647."""


def test_a_bundle_for_another_body_is_refused():
    truck = make_bundle()
    check_sensors(truck, TRUCK)
    named = r"'small' was built for another body: its sensor \w+ is at .* W\), but on this plant it is at .*"
    for refuse in (lambda: check_sensors(truck, SHORTER), lambda: BundlePolicy(truck, RecordingController(), SHORTER)):
        with pytest.raises(BundleError, match=named):
            refuse()


def test_positions_in_the_bundle_count_where_there_are_some():
    names = ("base_0", "base_1", "base_2", "base_3")
    places = tuple((5.0, float(SHORTER.positions[SHORTER.names.index(name), 1])) for name in names)
    built_for_it = make_bundle(sensors=names, sensor_positions=places)
    check_sensors(built_for_it, SHORTER)
    with pytest.raises(BundleError, match=r"sensor base_0 is at \(5 W, 0\.\d+ W\), but on this plant .* \(7\.647 W, "):
        check_sensors(built_for_it, TRUCK)


def test_a_policy_shows_what_the_ecu_would_and_keeps_nothing_but_its_memory():
    bundle, controller = make_bundle(), RecordingController(lambda i: 0.01 * (i + 1))
    window, horizon = bundle.manifest.window, bundle.manifest.mpc.horizon
    memory, rng = BundlePolicy(bundle, controller).start(), np.random.default_rng(1)
    rows = []
    columns = TRUCK.indices(bundle.manifest.sensors)
    for k in range(window + 3):
        Cp, action = rng.normal(size=COUNT), float(rng.normal())
        rows.append([*Cp[columns], action])
        kept = memory.copy()
        command, after = BundlePolicy(bundle, controller).step(memory, Cp, action)
        assert np.array_equal(memory, kept)
        memory = after
        assert len(controller.calls) == max(0, k - window + 2)
        if k < window - 1:
            assert command == 0.0
            continue
        shown, plan, free = controller.calls[-1]
        assert np.array_equal(shown, rows[-window:])
        # The last plan as it came out; at first, none.
        assert plan.tolist() == ([0.0] * horizon if k == window - 1 else [0.01 * (i + 1) for i in range(horizon)])
        assert (free.tolist(), command) == ([1.0] * horizon, 0.01)
