"""The ECU with the shipped sensor estimator on recorded pressures: what is on the bus, what the controller sees."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from can_bridge.wire.messages import Mode, Reason
from contract import sensors
from contract.config.vehicle import BenefitCheckConfig
from contract.recording import dataset
from contract.release import bundle
from contract.release.checks import Bundle
from contract.shipped import BUNDLE, recording
from tests.each import each
from tests.ecu.conftest import RecordingController, make_bench

RELEASE = bundle.load(BUNDLE)
COLUMNS = sensors.TRUCK.indices(RELEASE.manifest.sensors)
QUANTUM = 0.1 / 375.0
"""Of the wire, in Cp."""


@pytest.fixture(scope="module")
def pressures() -> np.ndarray:
    """Cp of the uncontrolled wake, (n, 4): the controller here leaves the jets shut, so that they fit."""
    (episode,) = [item for item in dataset.read(recording()).episodes if item.name == "none_0"]
    return episode.series["Cp"][:, COLUMNS]


def started(bundle: Bundle = RELEASE, **settings: Any) -> Any:
    # A controller that leaves the jets shut helps nobody.
    unchecked = BenefitCheckConfig(enabled=False)
    return make_bench(RecordingController(lambda i: 0.0), bundle=bundle, benefit_check=unchecked, **settings)


def drive(bench: Any, pressures, steps, read=lambda cp, k: cp, *, enable=True, first=None):
    """Steps from where the bench stands in the recording; the commands."""
    begin = bench.frames if first is None else first
    return [
        bench.step(bench.pressure(read(pressures[k].copy(), k), enable=enable)) for k in range(begin, begin + steps)
    ]


def dead(j):
    def read(cp, k):
        cp[j] = 0.0
        return cp

    return read


@each("j", (1, 2))
def test_control_goes_on_without_a_dead_sensor_and_the_status_names_it_until_a_restart(pressures, j):
    bench = started()
    drive(bench, pressures, 80)
    commands = drive(bench, pressures, 60, dead(j))
    assert {command.mode for command in commands} == {Mode.CONTROL}
    assert (bench.status.set_aside, bench.status.reason) == (1 << j, Reason.NONE)
    # The controller sees the estimate, in all rows, also in those from before the fault was noticed.
    window = bench.controller.calls[-1][0]
    seen = pressures[bench.frames - len(window) : bench.frames]
    true = seen[:, j]
    assert np.sqrt(np.mean(np.square(window[:, j] - true))) < 0.25 * true.std()
    others = [i for i in range(4) if i != j]
    np.testing.assert_allclose(window[:, others], seen[:, others], atol=QUANTUM)
    if j == 1:
        # It reads well again, and control is requested again.
        drive(bench, pressures, 20)
        drive(bench, pressures, 5, enable=False)
        drive(bench, pressures, 20)
        assert bench.status.set_aside == 0b10
        bench.ecu.restore(started().ecu.state)
        drive(bench, pressures, 40)
        assert bench.status.set_aside == 0


def test_exchanged_sensors_latch_and_a_request_alone_does_not_end_it(pressures):
    bench = started()
    drive(bench, pressures, 80)
    commands = drive(bench, pressures, 150, lambda cp, k: cp[[2, 1, 0, 3]])
    assert commands[-1].mode is Mode.FAULT
    assert not commands[-1].enable
    assert bench.status.reason == Reason.IMPLAUSIBLE
    drive(bench, pressures, 6, lambda cp, k: cp[[2, 1, 0, 3]], enable=False)
    assert drive(bench, pressures, 6, lambda cp, k: cp[[2, 1, 0, 3]])[-1].mode is Mode.FAULT
    # The plugs are put right: when the pressures have agreed for some time, the next request counts.
    drive(bench, pressures, 250)
    drive(bench, pressures, 6, enable=False)
    assert drive(bench, pressures, 6)[-1].mode is Mode.CONTROL
    assert bench.status.reason == Reason.NONE


def test_two_sensors_that_drift_together_slowly_latch(pressures):
    """To 2.5 deviations in 250 periods: no single sensor explains it, and at no time do they disagree much. An
    estimator that knows no gusts saw 1.8; 2.2 pass unseen now, since a gust moves sensors together as well."""
    bench = started()
    drive(bench, pressures, 150)

    def read(cp, k):
        return cp + 0.128 * min(2.5, 0.01 * (k - 150)) * np.array([1, 1, 0, 0])

    assert Mode.FAULT in (drive(bench, pressures, 1, read)[0].mode for _ in range(400))
    assert (bench.status.reason, bench.status.set_aside) == (Reason.IMPLAUSIBLE, 0)


def test_switched_off_or_without_an_estimator_nothing_is_checked(pressures):
    off = replace(make_bench().config.ecu.sensor_check, enabled=False)
    bare = replace(RELEASE, manifest=replace(RELEASE.manifest, sensor_estimator=None), files={})
    for made, settings in ((RELEASE, {"sensor_check": off}), (bare, {})):
        bench = started(made, **settings)
        drive(bench, pressures, 80)
        drive(bench, pressures, 60, dead(1))
        assert bench.status.set_aside == 0
        assert bench.controller.calls[-1][0][-1, 1] == 0.0
