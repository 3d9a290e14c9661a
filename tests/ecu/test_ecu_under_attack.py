"""Someone on the bus who knows the DBC, and not the key: authentication lets none of it through."""

from dataclasses import replace

from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import Authentication
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import SECURED
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Reason
from contract.config.tree import Config
from contract.config.vehicle import BenefitCheckConfig, BusConfig, EcuConfig
from ecu.ecu import Ecu
from tests.ecu.conftest import ByHand, RecordingController, make_bundle

KEY, ANOTHER = Key(b"the nodes' secret"[:16]), Key(b"an attacker's own"[:16])
TRUE, FALSE = (0.1,) * 4, (0.7,) * 4  # pressures in units of the dynamic pressure
# Pressures that stay the same show no benefit.
CONFIG = Config(bus=BusConfig(key="key"), ecu=EcuConfig(benefit_check=BenefitCheckConfig(enabled=False)))


class Bus:
    """An ECU with this key, the vehicle, and an attacker with another key."""

    def __init__(self, key: Key = KEY) -> None:
        self.controller, self.recorded, self.now_ns = RecordingController(), list[Frame](), 1_000_000
        self.ecu = Ecu(make_bundle(), self.controller, CONFIG, authentication=Authentication(key=key, trip=5))
        self.attacker = ByHand(CONFIG, Authentication(key=ANOTHER, trip=1))
        self.start_vehicle(trip=1)

    def start_vehicle(self, trip: int) -> None:
        self.vehicle = ByHand(CONFIG, Authentication(key=KEY, trip=trip))

    def genuine(self) -> Frame:
        # The request has to rise after power-on, so the first frame is without it.
        self.recorded.append(self.vehicle.pressures(TRUE, asks=self.vehicle.frames_sent > 0))
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
    bus = Bus()
    bus.good(8)
    for _ in range(100):
        command, status = bus.step(bus.attacker.pressures(FALSE, asks=True), bus.genuine())
        assert command.mode is Mode.CONTROL
        assert abs(bus.controller.calls[-1][0][-1, 0] - TRUE[0]) < 1e-3
    assert (status.not_authentic, status.refused, status.crc_errors) == (100, 0, 0)
    for _ in range(10):
        bus.step()
    bus.good(8)
    # The vehicle's request stays 1 throughout: only its own edge may end the fault.
    bus.step(bus.attacker.pressures(TRUE, asks=False), bus.genuine())
    assert bus.good(8)[0].mode is Mode.FAULT


def test_forged_and_old_frames_in_place_of_the_genuine_ones_shut_the_jets():
    for is_old in (False, True):
        bus = Bus()
        bus.good(264)
        for old in bus.recorded[8:18]:
            bus.genuine()
            command, status = bus.step(old if is_old else bus.attacker.pressures(FALSE, asks=True))
        assert (command.mode, command.enable, command.flow_m2_per_s) == (Mode.FAULT, False, 0.0)
        assert (status.reason, status.not_authentic) == (Reason.NOT_AUTHENTIC, 10)


def test_with_two_keys_the_reason_shows_it_from_the_first_period_on():
    """The vehicle's request is never heard."""
    bus = Bus(key=ANOTHER)
    for period in range(1, 30):
        command, status = bus.good(1)
        assert (command.mode, command.enable) == (Mode.OFF, False)
        assert (status.reason, status.not_authentic) == (Reason.NOT_AUTHENTIC, period)
    assert bus.step()[1].reason is Reason.NONE
    assert bus.ecu.state.frames_rejected == 29


def test_a_restarted_vehicle_is_followed_in_its_next_power_cycle_and_never_in_one_before():
    bus = Bus()
    bus.good(100)
    old = list(bus.recorded)
    bus.start_vehicle(trip=2)
    command, status = bus.good(8)
    assert (command.mode, status.not_authentic) == (Mode.CONTROL, 0)
    for frame in old:
        _, status = bus.step(frame, bus.genuine())
    # E2E refused one frame: the counter's jump at the restart.
    assert (status.not_authentic, status.refused) == (len(old), 1)
