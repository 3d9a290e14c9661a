"""Someone on the bus who knows the DBC, and not the key: authentication lets none of it through."""

from dataclasses import dataclass, field, replace

from can_bridge.e2e.sender import SenderState, protected_frame
from can_bridge.secoc.key import Key
from can_bridge.secoc.node import Authentication, secured
from can_bridge.secoc.securing import Freshness
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import SECURED
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Pressure, Reason
from contract.config.tree import Config
from contract.config.vehicle import BenefitCheckConfig, BusConfig, EcuConfig
from ecu.ecu import Ecu
from tests.ecu.conftest import RecordingController, make_bundle

KEY, ANOTHER = Key(b"the nodes' secret"[:16]), Key(b"an attacker's own"[:16])
TRUE, FALSE = 0.1, 0.7
"""Pressures in units of the dynamic pressure, genuine and forged."""
# Pressures that stay the same show no benefit.
CONFIG = Config(bus=BusConfig(key="key"), ecu=EcuConfig(benefit_check=BenefitCheckConfig(enabled=False)))


@dataclass
class Bench:
    """An ECU with this key, and the vehicle's sender; whatever is forged is made with another key."""

    key: Key = KEY
    now_ns: int = 1_000_000
    sent: int = 0
    trip: int = 1
    recorded: list[Frame] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.controller = RecordingController()
        self.ecu = Ecu(make_bundle(), self.controller, CONFIG, authentication=Authentication(key=self.key, trip=5))

    def pressure(self, *, enable=True, cp=TRUE, key: Key = ANOTHER) -> Frame:
        spec, scale = SECURED.pressure.spec, CONFIG.operating_point.dynamic_pressure
        # The request has to rise after power-on, so the first frame is without it.
        requested = enable and self.sent > 0
        value = Pressure(pressure_pa=(cp * scale,) * 4, valid=(True,) * 4, enable_request=requested, age_ns=0)
        counter = SenderState(counter=self.sent % 256)
        frame = protected_frame(counter, SECURED.pressure.emit(value), spec=spec, now_ns=self.now_ns)
        return secured(frame, spec=spec, key=key, freshness=Freshness(trip=self.trip, count=self.sent))

    def genuine(self) -> Frame:
        self.recorded.append(self.pressure(key=KEY))
        self.sent += 1
        return self.recorded[-1]

    def step(self, *frames: Frame) -> tuple[JetCommand, EcuStatus]:
        arrived = [replace(frame, timestamp_ns=self.now_ns) for frame in frames]
        command_frame, status_frame = self.ecu.step(self.now_ns, arrived)
        self.now_ns += CONFIG.period_ns
        command = SECURED.command.parse(command_frame.data[: SECURED.command.spec.protected])
        status = SECURED.status.parse(status_frame.data[: SECURED.status.spec.protected])
        assert command is not None and status is not None
        return command, status

    def good(self, periods: int) -> tuple[JetCommand, EcuStatus]:
        return [self.step(self.genuine()) for _ in range(periods)][-1]


def test_forged_frames_ahead_of_the_genuine_ones_change_nothing_and_do_not_re_arm():
    bench = Bench()
    bench.good(8)
    for _ in range(100):
        command, status = bench.step(bench.pressure(cp=FALSE), bench.genuine())
        assert command.mode is Mode.CONTROL
        assert abs(bench.controller.calls[-1][0][-1, 0] - TRUE) < 1e-3
    assert (status.not_authentic, status.refused, status.crc_errors) == (100, 0, 0)
    for _ in range(10):
        bench.step()
    bench.good(8)
    # The vehicle's request stays 1 throughout: only its own edge may end the fault.
    bench.step(bench.pressure(enable=False), bench.genuine())
    assert bench.good(8)[0].mode is Mode.FAULT


def test_forged_and_old_frames_in_place_of_the_genuine_ones_shut_the_jets():
    for is_old in (False, True):
        bench = Bench()
        bench.good(264)
        for old in bench.recorded[8:18]:
            command, status = bench.step(old if is_old else bench.pressure(cp=FALSE))
            bench.sent += 1
        assert (command.mode, command.enable, command.flow_m2_per_s) == (Mode.FAULT, False, 0.0)
        assert (status.reason, status.not_authentic) == (Reason.NOT_AUTHENTIC, 10)


def test_with_two_keys_the_reason_shows_it_from_the_first_period_on():
    """The vehicle's request is never heard."""
    bench = Bench(key=ANOTHER)
    for period in range(1, 30):
        command, status = bench.good(1)
        assert (command.mode, command.enable) == (Mode.OFF, False)
        assert (status.reason, status.not_authentic) == (Reason.NOT_AUTHENTIC, period)
    assert bench.step()[1].reason is Reason.NONE
    assert bench.ecu.frames_rejected == 29


def test_a_restarted_vehicle_is_followed_in_its_next_power_cycle_and_never_in_one_before():
    bench = Bench()
    bench.good(100)
    old = list(bench.recorded)
    bench.trip, bench.sent = 2, 0
    command, status = bench.good(8)
    assert (command.mode, status.not_authentic) == (Mode.CONTROL, 0)
    for frame in old:
        _, status = bench.step(frame, bench.genuine())
    # E2E refused one frame: the counter's jump at the restart.
    assert (status.not_authentic, status.refused) == (len(old), 1)
