"""The tester's side of calibration against the real server, by udsoncan without a bus, in virtual time."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from can_bridge.tester import calibration
from can_bridge.tester.asking import Asking
from can_bridge.tester.messages import AccessError, NotNowError
from can_bridge.uds.access_key import AccessKey
from can_bridge.uds.services import Session
from contract.errors import ConfigError, FlashError

udsoncan = pytest.importorskip("udsoncan")

from udsoncan.client import Client  # noqa: E402

from tests.can_bridge.tester.calibrated_ecu import KEY, OWN, Direct, Ecu  # noqa: E402


@pytest.fixture
def ecu() -> Ecu:
    return Ecu()


@pytest.fixture
def asking(ecu) -> Iterator[Asking]:
    connection = Direct(ecu)

    def sleep(seconds: float) -> None:
        connection.now_ns += round(seconds * 1e9)

    with Client(connection) as client:
        yield Asking(client, key=KEY.answer, clock=lambda: connection.now_ns / 1e9, sleep=sleep)


def test_it_reads_without_a_key_and_in_the_default_session(ecu, asking):
    found = calibration.read(asking)
    assert ecu.server.session is Session.DEFAULT
    assert found.in_force == found.release == OWN.as_kept()
    assert found.limits.greatest.delay_steps == 3
    assert found.limits.least.action_limit == np.float32(0.01)
    assert not found.is_stored


def test_values_are_written_read_back_and_taken_at_once(ecu, asking):
    wanted = calibration.changed(calibration.read(asking), {"lift": 0.3, "command_step": 0.02, "delay_steps": 2.0})
    calibration.unlock(asking)
    calibration.write(asking, wanted)
    taken = ecu.segment.take()
    assert taken is not None
    assert taken.weights.as_tuple() == pytest.approx((1.0, 0.1, 0.3, 0.0, 8.0, 0.0, 0.0))
    assert (taken.command_step, taken.delay_steps) == (np.float32(0.02), 2)
    assert calibration.read(asking).in_force == wanted


def test_stored_values_outlive_power_and_reverted_ones_do_not(ecu, asking):
    found = calibration.read(asking)
    calibration.unlock(asking)
    calibration.write(asking, calibration.changed(found, {"effort": 0.5}))
    calibration.store(asking)
    ecu.power_on()
    found = calibration.read(asking)
    assert (found.in_force.weights.effort, found.is_stored) == (0.5, True)
    calibration.unlock(asking)
    calibration.revert(asking, found.release)
    ecu.power_on()
    found = calibration.read(asking)
    assert (found.in_force, found.is_stored) == (OWN.as_kept(), False)


def test_while_the_jets_run_values_change_and_are_not_stored(ecu, asking):
    ecu.jets = True
    found = calibration.read(asking)
    calibration.unlock(asking)
    calibration.write(asking, calibration.changed(found, {"effort": 0.5}))
    with pytest.raises(NotNowError, match="its jets are enabled"):
        calibration.store(asking)
    assert calibration.read(asking).in_force.weights.effort == 0.5
    assert ecu.raw is None


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"drag": 1.0}, "'drag' is none of drag_mean"),
        ({"delay_steps": 1.5}, "whole number"),
        ({"delay_steps": float("nan")}, "whole number"),
        ({"delay_steps": -1.0}, "delay_steps = -1: must be in 0..3"),
        ({"delay_steps": 1e12}, "delay_steps"),
        ({"lift": 10.1}, "lift = 10.1: must be in 0..10"),
        ({"lift": 1e300}, "lift"),
        ({"lift": float("inf")}, "lift"),
        ({"action_limit": float("nan")}, "action_limit"),
        ({"action_limit": 0.0701}, "action_limit = 0.0701: must be in 0.01..0.07"),
    ],
)
def test_a_value_is_refused_before_anything_is_sent(asking, values, message):
    with pytest.raises(ConfigError, match=message):
        calibration.changed(calibration.read(asking), values)


def test_the_limits_themselves_are_allowed_as_people_write_them(asking):
    changed = calibration.changed(calibration.read(asking), {"action_limit": 0.07, "command_step": 0.075, "lift": 10.0})
    calibration.unlock(asking)
    calibration.write(asking, changed)


def test_another_tools_values_are_noticed(ecu, asking):
    found = calibration.read(asking)
    calibration.unlock(asking)
    serve = ecu.service.write
    other = replace(OWN, delay_steps=3)

    def write(did, value):
        yield from serve(did, value)
        ecu.segment.set(other)

    ecu.service.write = write
    with pytest.raises(FlashError, match="another tool"):
        calibration.write(asking, calibration.changed(found, {"lift": 0.5}))


def test_with_another_key_nothing_changes(ecu):
    with Client(connection := Direct(ecu)) as client:
        other = Asking(client, key=AccessKey(bytes(range(2, 18))).answer, clock=lambda: 0.0, sleep=lambda s: None)
        with pytest.raises(AccessError, match="refused the key"):
            calibration.unlock(other)
    answers = ecu.server.request(connection.now_ns, bytes([0x2E, 0xFD, 0x10]) + OWN.pack())
    assert answers == [bytes([0x7F, 0x2E, 0x33])]


def test_an_ecu_without_a_release_has_none(ecu, asking):
    ecu.has_release = False
    with pytest.raises(FlashError, match="no release runs in it"):
        calibration.read(asking)
