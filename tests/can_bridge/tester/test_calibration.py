"""The tester's side of calibration against the real server, by udsoncan without a bus, in virtual time."""

from dataclasses import replace

import pytest

from can_bridge.tester import calibration
from contract.errors import ConfigError, FlashError
from tests.can_bridge.tester.ecus import OWN, Ecu
from tests.can_bridge.tester.line import Line


def test_a_value_is_refused_before_anything_is_sent_and_another_tools_values_are_noticed(monkeypatch):
    ecu = Ecu()
    asking = Line(ecu).asking()
    read = calibration.read(asking)
    for name, value, message in (
        ("drag", 1.0, "'drag' must be one of drag_mean"),
        ("delay_steps", 1.5, "whole number"),
        ("delay_steps", float("nan"), "whole number"),
        ("delay_steps", 1e12, "delay_steps"),
        ("lift", 10.1, "lift = 10.1: must be in 0..10"),
        ("lift", 1e300, "lift"),
        ("action_limit", 0.0701, "action_limit = 0.0701: must be in 0.01..0.07"),
    ):
        with pytest.raises(ConfigError, match=message):
            read.limits.changed(read.in_force, {name: value})
    # The limits themselves are allowed as people write them.
    calibration.unlock(asking)
    limits = {"action_limit": 0.07, "command_step": 0.075, "lift": 10.0}
    calibration.write(asking, read.limits.changed(read.in_force, limits))
    serve = ecu.service.write

    def write(did, value):
        serve(did, value)
        ecu.segment.set(replace(OWN, delay_steps=3))

    monkeypatch.setattr(ecu.service, "write", write)
    with pytest.raises(FlashError, match="another tool"):
        calibration.write(asking, read.limits.changed(read.in_force, {"lift": 0.5}))
