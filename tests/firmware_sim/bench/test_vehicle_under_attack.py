"""Someone on the bus who knows the DBC, and not the key, wants the jets: with E2E alone, and with authentication."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

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

NAMES = ("upper_39", "lower_39", "base_0", "base_9")
KEY, ANOTHER = Key(b"the nodes' secret"[:16]), Key(b"an attacker's own"[:16])
TRUE, FALSE = 0.5, -1.5
"""Flow rates in m2/s, commanded and forged."""


@dataclass
class Drive:
    """The vehicle's node, and an ECU's sender beside it."""

    node: VehicleNode
    config: Config
    authenticated: bool
    period: int = 0
    recorded: list[Frame] = field(default_factory=list)

    def command(self, flow: float, key: Key) -> Frame:
        messages = message_set(self.config.bus)
        spec = messages.command.spec
        echo = self.period % profile_of(messages.pressure.spec).counter_period
        message = JetCommand(flow_m2_per_s=flow, mode=Mode.CONTROL, enable=True, pressure_counter=echo)
        counter = SenderState(counter=self.period % profile_of(spec).counter_period)
        frame = protected_frame(counter, messages.command.emit(message), spec=spec, now_ns=self.now_ns)
        used = key if self.authenticated else None
        return secured(frame, spec=spec, key=used, freshness=Freshness(count=self.period))

    @property
    def now_ns(self) -> int:
        return self.period * self.config.period_ns

    def drive(self, forge: Callable[[], list[Frame]] = list, *, genuine=True) -> float:
        """One period, the forged frames ahead of the genuine one; what the jets do, in m2/s."""
        self.node.sample(np.zeros(sensors.COUNT), enable_request=True, now_ns=self.now_ns)
        frames = forge()
        if genuine:
            frames.append(self.command(TRUE, KEY))
            self.recorded.append(frames[-1])
        action = self.node.apply_commands(frames).action
        self.period += 1
        return action * self.config.operating_point.flow_rate_scale


def drive_in(*, authenticated: bool) -> Drive:
    """After 300 periods in order."""
    config = Config(bus=BusConfig(key="key" if authenticated else ""))
    node = VehicleNode(NAMES, config, sensors.TRUCK, Authentication(key=KEY) if authenticated else None)
    made = Drive(node, config, authenticated)
    for _ in range(300):
        flow = made.drive()
    assert flow == pytest.approx(TRUE)
    return made


@pytest.fixture(params=[False, True], ids=["E2E alone", "authenticated"])
def drive(request) -> Drive:
    return drive_in(authenticated=request.param)


def test_forged_commands_ahead_of_the_genuine_ones(drive):
    for _ in range(50):
        action = drive.drive(lambda: [drive.command(FALSE, ANOTHER)])
        assert action == pytest.approx(TRUE if drive.authenticated else FALSE)
    assert drive.node.frames_not_authentic == (50 if drive.authenticated else 0)
    assert drive.node.frames_rejected == 50


def test_forged_commands_with_the_ecu_silent(drive):
    for _ in range(10):
        action = drive.drive(lambda: [drive.command(FALSE, ANOTHER)], genuine=False)
    assert action == (0.0 if drive.authenticated else pytest.approx(FALSE))


def test_commands_of_256_periods_ago_with_the_ecu_silent(drive):
    for _ in range(10):
        # The same counter, and at an equal place in the echo's period the same echo.
        old = replace(drive.recorded[drive.period - 256], timestamp_ns=drive.now_ns)
        action = drive.drive(lambda old=old: [old], genuine=False)
    assert action == (0.0 if drive.authenticated else pytest.approx(TRUE))


def test_every_flipped_bit_is_refused_before_e2e_sees_it():
    drive = drive_in(authenticated=True)
    for bit in range(8 * 24):
        frame = drive.command(TRUE, KEY)
        flipped = replace(frame, data=(int.from_bytes(frame.data, "big") ^ 1 << bit).to_bytes(24, "big"))
        assert drive.drive(lambda flipped=flipped: [flipped]) == pytest.approx(TRUE)  # type: ignore[misc]
    assert drive.node.frames_not_authentic == drive.node.frames_rejected == 8 * 24
