"""Someone on the bus who knows the DBC, and not the key: what E2E lets pass, and authentication does not."""

from dataclasses import dataclass, field, replace

import pytest

from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.sender import SenderState, protected_frame
from can_bridge.secoc.key import Key
from can_bridge.secoc.node import Authentication, secured
from can_bridge.secoc.securing import Freshness
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Pressure, Reason
from contract.config.tree import Config
from contract.config.vehicle import BenefitCheckConfig, BusConfig, EcuConfig
from ecu.ecu import Ecu
from tests.ecu.conftest import RecordingController, make_bundle

KEY, ANOTHER = Key(b"the nodes' secret"[:16]), Key(b"an attacker's own"[:16])
TRUE, FALSE = 0.1, 0.7
"""Pressures in units of the dynamic pressure, genuine and forged."""


@dataclass
class Bench:
    """An ECU and the vehicle's sender, with or without authentication; whatever is forged is made with another key."""

    authenticated: bool
    key: Key = KEY
    now_ns: int = 1_000_000
    sent: int = 0
    trip: int = 1
    recorded: list[Frame] = field(default_factory=list)

    def __post_init__(self) -> None:
        # Pressures that stay the same show no benefit.
        ecu = EcuConfig(benefit_check=BenefitCheckConfig(enabled=False))
        self.config = Config(bus=BusConfig(key="key" if self.authenticated else ""), ecu=ecu)
        self.controller = RecordingController()
        authentication = Authentication(key=self.key, trip=5) if self.authenticated else None
        self.ecu = Ecu(make_bundle(), self.controller, self.config, authentication=authentication)

    def pressure(self, *, number: int | None = None, enable=True, cp=TRUE, key: Key = KEY) -> Frame:
        number = self.sent if number is None else number
        message = message_set(self.config.bus).pressure
        scale = self.config.operating_point.dynamic_pressure
        # The request has to rise after power-on, so the first frame is without it.
        requested = enable and number > 0
        value = Pressure(pressure_pa=(cp * scale,) * 4, valid=(True,) * 4, enable_request=requested, age_ns=0)
        counter = SenderState(counter=number % profile_of(message.spec).counter_period)
        frame = protected_frame(counter, message.emit(value), spec=message.spec, now_ns=self.now_ns)
        freshness = Freshness(trip=self.trip, count=number)
        return secured(frame, spec=message.spec, key=key if self.authenticated else None, freshness=freshness)

    def genuine(self, *, enable=True) -> Frame:
        self.recorded.append(self.pressure(enable=enable))
        self.sent += 1
        return self.recorded[-1]

    def forged(self, *, enable=True) -> Frame:
        return self.pressure(enable=enable, cp=FALSE, key=ANOTHER)

    def replayed(self, frame: Frame) -> Frame:
        return replace(frame, timestamp_ns=self.now_ns)

    def step(self, *frames: Frame) -> tuple[JetCommand, EcuStatus]:
        command_frame, status_frame = self.ecu.step(self.now_ns, frames)
        self.now_ns += self.config.period_ns
        messages = message_set(self.config.bus)
        command = messages.command.parse(command_frame.data[: messages.command.spec.protected])
        status = messages.status.parse(status_frame.data[: messages.status.spec.protected])
        assert command is not None and status is not None
        return command, status

    def good(self, periods: int) -> tuple[JetCommand, EcuStatus]:
        return [self.step(self.genuine()) for _ in range(periods)][-1]

    @property
    def seen(self) -> float:
        """The newest pressure that the controller planned on."""
        return self.controller.calls[-1][0][-1, 0]


@pytest.fixture(params=[False, True], ids=["E2E alone", "authenticated"])
def bench(request) -> Bench:
    bench = Bench(authenticated=request.param)
    command, _ = bench.good(8)
    assert command.mode is Mode.CONTROL
    return bench


def test_forged_pressures_ahead_of_the_genuine_ones(bench):
    for _ in range(100):
        command, status = bench.step(bench.forged(), bench.genuine())
        assert command.mode is Mode.CONTROL
        # With E2E alone the forgery is used, and the genuine frame is taken for its repetition.
        assert bench.seen == pytest.approx(TRUE if bench.authenticated else FALSE, abs=1e-3)
    assert (status.not_authentic, status.refused) == ((100, 0) if bench.authenticated else (0, 100))
    assert status.crc_errors == 0


@pytest.mark.parametrize("attack", ["forged", "of 256 periods ago"])
def test_other_pressures_in_place_of_the_genuine_ones(bench, attack):
    bench.good(256)
    old = [*bench.recorded[-256:]]
    for number in range(10):
        command, status = bench.step(bench.forged() if attack == "forged" else bench.replayed(old[number]))
        bench.sent += 1
    if bench.authenticated:
        assert (command.mode, command.enable, command.flow_m2_per_s) == (Mode.FAULT, False, 0.0)
        assert (status.reason, status.not_authentic) == (Reason.NOT_AUTHENTIC, 10)
    else:
        assert command.mode is Mode.CONTROL
        assert attack != "forged" or bench.seen == pytest.approx(FALSE, abs=1e-3)


def test_a_forged_request_does_not_re_arm_a_latched_fault(bench):
    for _ in range(10):
        command, _ = bench.step()
    assert command.mode is Mode.FAULT
    bench.good(8)
    # The vehicle's request stays 1 throughout: only its own edge may end the fault.
    bench.step(bench.forged(enable=False), bench.genuine())
    bench.sent += not bench.authenticated  # the forgery took the genuine frame's counter
    command, _ = bench.good(8)
    assert command.mode is (Mode.FAULT if bench.authenticated else Mode.CONTROL)


def test_with_two_keys_the_reason_shows_it_from_the_first_period_on():
    """The vehicle's request is never heard."""
    bench = Bench(authenticated=True, key=ANOTHER)
    for period in range(1, 30):
        command, status = bench.good(1)
        assert (command.mode, command.enable) == (Mode.OFF, False)
        assert (status.reason, status.not_authentic) == (Reason.NOT_AUTHENTIC, period)
    _, status = bench.step()
    assert status.reason is Reason.NONE
    assert bench.ecu.frames_rejected == 29


def test_a_restarted_vehicle_is_followed_in_its_next_power_cycle_and_never_in_one_before():
    bench = Bench(authenticated=True)
    bench.good(100)
    old = list(bench.recorded)
    bench.trip, bench.sent = 2, 0
    command, status = bench.good(8)
    assert (command.mode, status.not_authentic) == (Mode.CONTROL, 0)
    for frame in old:
        _, status = bench.step(bench.replayed(frame), bench.genuine())
    # E2E refused one frame: the counter's jump at the restart.
    assert (status.not_authentic, status.refused) == (len(old), 1)
