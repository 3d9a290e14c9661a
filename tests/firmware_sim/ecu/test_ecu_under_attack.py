"""Someone on the bus who knows the DBC, and not the key: what E2E lets pass, and authentication does not."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import pytest

from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.sender import SenderState, protected_frame
from can_bridge.secoc.freshness import Freshness
from can_bridge.secoc.key import Key
from can_bridge.secoc.node import Authentication, secured
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Pressure, Reason
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from firmware_sim.ecu.ecu import Ecu

KEY, ANOTHER = Key(b"the nodes' secret"[:16]), Key(b"an attacker's own"[:16])
TRUE, FALSE = 0.1, 0.7
"""Pressures in units of the dynamic pressure, genuine and forged."""


@dataclass
class Bench:
    """An ECU and the vehicle's sender, with or without authentication; whatever is forged is made with another key."""

    ecu: Ecu
    config: Config
    controller: object
    authenticated: bool
    now_ns: int = 1_000_000
    sent: int = 0
    trip: int = 1
    recorded: list[Frame] = field(default_factory=list)

    def pressure(self, *, number: int | None = None, enable=True, cp=TRUE, key: Key = KEY) -> Frame:
        number = self.sent if number is None else number
        # The request has to rise after power-on, so the first frame is without it.
        enable = enable and number > 0
        message = message_set(self.config.bus).pressure
        scale = self.config.operating_point.dynamic_pressure
        value = Pressure(pressure_pa=(cp * scale,) * 4, valid=(True,) * 4, enable_request=enable, age_ns=0)
        counter = SenderState(counter=number % profile_of(message.spec).counter_period)
        frame = protected_frame(counter, message.emit(value), spec=message.spec, now_ns=self.now_ns)
        freshness = Freshness(trip=self.trip, count=number)
        return secured(frame, spec=message.spec, key=key if self.authenticated else None, freshness=freshness)

    def genuine(self, *, enable=True) -> Frame:
        frame = self.pressure(enable=enable)
        self.recorded.append(frame)
        self.sent += 1
        return frame

    def forged(self, *, ahead: int = 0, enable=True, cp=FALSE) -> Frame:
        return self.pressure(number=self.sent + ahead, enable=enable, cp=cp, key=ANOTHER)

    def replayed(self, number: int) -> Frame:
        return replace(self.recorded[number], timestamp_ns=self.now_ns)

    def step(self, *frames: Frame) -> tuple[JetCommand, EcuStatus]:
        command, status = self.ecu.step(self.now_ns, frames)
        self.now_ns += self.config.period_ns
        messages = message_set(self.config.bus)
        found = messages.command.parse(command.data[: messages.command.spec.protected])
        health = messages.status.parse(status.data[: messages.status.spec.protected])
        assert found is not None
        assert health is not None
        return found, health

    def good(self, periods: int, *, enable=True) -> tuple[JetCommand, EcuStatus]:
        return [self.step(self.genuine(enable=enable)) for _ in range(periods)][-1]

    @property
    def seen(self) -> float:
        """The newest pressure that the controller planned on."""
        return self.controller.calls[-1][0][-1, 0]  # type: ignore[attr-defined]


@pytest.fixture
def bench_in(bundle_of, recording_controller) -> Callable[..., Bench]:
    def make(*, authenticated: bool, key: Key = KEY) -> Bench:
        config = Config(bus=BusConfig(key="key" if authenticated else ""))
        controller = recording_controller()
        authentication = Authentication(key=key, trip=5) if authenticated else None
        ecu = Ecu(bundle_of(), controller, config, authentication=authentication)
        return Bench(ecu, config, controller, authenticated)

    return make


@pytest.fixture(params=[False, True], ids=["E2E alone", "authenticated"])
def bench(request, bench_in) -> Bench:
    made = bench_in(authenticated=request.param)
    command, _ = made.good(8)
    assert command.mode is Mode.CONTROL
    return made


def test_forged_pressures_ahead_of_the_genuine_ones(bench):
    for _ in range(100):
        command, status = bench.step(bench.forged(), bench.genuine())
        assert command.mode is Mode.CONTROL
        # With E2E alone the forgery is used, and the genuine frame is taken for its repetition.
        assert bench.seen == pytest.approx(TRUE if bench.authenticated else FALSE, abs=1e-3)
    assert (status.not_authentic, status.refused) == ((100, 0) if bench.authenticated else (0, 100))
    assert status.crc_errors == 0


def test_forged_pressures_in_place_of_the_genuine_ones(bench):
    for _ in range(10):
        command, status = bench.step(bench.forged())
        bench.sent += 1
    if bench.authenticated:
        assert (command.mode, command.enable, command.flow_m2_per_s) == (Mode.FAULT, False, 0.0)
        assert (status.reason, status.not_authentic) == (Reason.NOT_AUTHENTIC, 10)
    else:
        assert command.mode is Mode.CONTROL
        assert bench.seen == pytest.approx(FALSE, abs=1e-3)


def test_frames_of_256_periods_ago_with_the_vehicle_silent(bench):
    bench.good(256)
    for number in range(bench.sent - 256, bench.sent - 156):
        command, status = bench.step(bench.replayed(number))
    if bench.authenticated:
        assert (command.mode, command.flow_m2_per_s) == (Mode.FAULT, 0.0)
        assert (status.reason, status.not_authentic) == (Reason.NOT_AUTHENTIC, 100)
    else:
        assert command.mode is Mode.CONTROL


def test_a_forged_request_does_not_re_arm_a_latched_fault(bench):
    for _ in range(10):
        command, _ = bench.step()
    assert command.mode is Mode.FAULT
    bench.good(8)
    # The vehicle's request stays 1 throughout: only its own edge may end the fault.
    command, _ = bench.step(bench.forged(enable=False), bench.genuine())
    bench.sent += not bench.authenticated  # the forgery took the genuine frame's counter
    command, _ = bench.good(8)
    assert command.mode is (Mode.FAULT if bench.authenticated else Mode.CONTROL)


def test_two_keys_are_told_from_the_first_period_on(bench_in):
    """The vehicle's request is never heard: the reason alone says why nothing happens."""
    bench = bench_in(authenticated=True, key=ANOTHER)
    for period in range(1, 30):
        command, status = bench.step(bench.genuine())
        assert (command.mode, command.enable) == (Mode.OFF, False)
        assert (status.reason, status.not_authentic) == (Reason.NOT_AUTHENTIC, period)
    _, status = bench.step()
    assert status.reason is Reason.NONE
    assert bench.ecu.frames_rejected == 29


def test_another_key_under_way_latches(bench_in):
    bench = bench_in(authenticated=True)
    bench.good(8)
    story = [bench.step(bench.forged(ahead=ahead)) for ahead in range(5)]
    assert [command.mode for command, _ in story][:1] == [Mode.HOLD]
    assert [command.mode for command, _ in story][-1] is Mode.FAULT
    assert all(status.reason is Reason.NOT_AUTHENTIC for _, status in story)
    assert story[-1][0].flow_m2_per_s == 0.0


def test_restarted_vehicle_in_its_next_power_cycle_is_followed(bench_in):
    bench = bench_in(authenticated=True)
    bench.good(100)
    old = list(bench.recorded)
    bench.trip, bench.sent = 2, 0
    command, status = bench.good(8)
    assert (command.mode, status.not_authentic) == (Mode.CONTROL, 0)
    # Without a power cycle counted, the same restart is refused.
    bench.trip = 1
    command, status = bench.step(bench.pressure(number=1000))
    assert (status.not_authentic, status.reason) == (1, Reason.NOT_AUTHENTIC)
    # And the power cycle before is over. E2E refused one frame: the counter's jump at the restart.
    bench.trip = 2
    for frame in old:
        _, status = bench.step(replace(frame, timestamp_ns=bench.now_ns), bench.genuine())
    assert (status.not_authentic, status.refused) == (1 + len(old), 1)
