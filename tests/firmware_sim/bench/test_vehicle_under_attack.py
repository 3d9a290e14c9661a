"""Someone on the bus who knows the DBC, and not the key, wants the jets: with E2E alone, and with authentication."""

from dataclasses import replace

import numpy as np
import pytest

from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.sender import SenderState, protected_frame
from can_bridge.secoc.freshness import Freshness
from can_bridge.secoc.key import Key
from can_bridge.secoc.node import Authentication, secured
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import JetCommand, Mode
from contract import sensors
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from firmware_sim.bench.vehicle_node import VehicleNode
from tests.each import each
from tests.firmware_sim.bench.harness import NAMES

KEY, ANOTHER = Key(b"the nodes' secret"[:16]), Key(b"an attacker's own"[:16])
TRUE, FALSE = 0.5, -1.5
"""Flow rates in m2/s, commanded and forged."""


@each("authenticated", [False, True])
def test_forged_and_replayed_commands_drive_only_where_nothing_is_authenticated(authenticated):
    config = Config(bus=BusConfig(key="key" if authenticated else ""))
    node = VehicleNode(NAMES, config, sensors.TRUCK, Authentication(key=KEY) if authenticated else None)
    messages = message_set(config.bus)
    recorded: list[Frame] = []

    def command(flow: float, key: Key, period: int) -> Frame:
        spec = messages.command.spec
        echo = period % profile_of(messages.pressure.spec).counter_period
        message = JetCommand(flow_m2_per_s=flow, mode=Mode.CONTROL, enable=True, pressure_counter=echo)
        counter, now_ns = SenderState(counter=period % profile_of(spec).counter_period), period * config.period_ns
        frame = protected_frame(counter, messages.command.emit(message), spec=spec, now_ns=now_ns)
        return secured(frame, spec=spec, key=key if authenticated else None, freshness=Freshness(count=period))

    def driven(period: int, *frames: Frame) -> float:
        node.sample(np.zeros(sensors.COUNT), enable_request=True, now_ns=period * config.period_ns)
        return node.apply_commands(frames).action * config.operating_point.flow_rate_scale

    for period in range(300):
        recorded.append(command(TRUE, KEY, period))
        flow = driven(period, recorded[-1])
    assert flow == pytest.approx(TRUE)
    # Ahead of the genuine one.
    for period in range(300, 350):
        flow = driven(period, command(FALSE, ANOTHER, period), command(TRUE, KEY, period))
        assert flow == pytest.approx(TRUE if authenticated else FALSE)
    assert (node.frames_not_authentic, node.frames_rejected) == (50 if authenticated else 0, 50)
    # With the ECU silent: made, and of 256 periods ago, whose counter and echo are the same.
    for period in range(350, 360):
        flow = driven(period, command(FALSE, ANOTHER, period))
    assert flow == (0.0 if authenticated else pytest.approx(FALSE))
    for period in range(360, 370):
        flow = driven(period, replace(recorded[period - 256], timestamp_ns=period * config.period_ns))
    assert flow == (0.0 if authenticated else pytest.approx(TRUE))
