"""The vehicle's node: what its transducers put on the bus, and what its jets make of commands."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.e2e.profiles import PROFILE_5, E2eSender, SenderState, profile_of, protected_frame
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import Authentication, Freshness, secured
from can_bridge.wire import codec
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import JET_COMMAND
from can_bridge.wire.messages import JetCommand, Mode, Pressure
from contract import sensors
from contract.config.operating_point import OperatingPoint
from contract.config.tree import Config
from contract.config.vehicle import BusConfig, EcuConfig, VehicleConfig
from firmware_sim.bench.vehicle_node import EchoTracker, VehicleNode
from tests.each import each
from tests.examples import examples

NAMES = ("base_3", "upper_00", "lower_39", "upper_39")
CONFIG = Config()
SCALE = CONFIG.operating_point.flow_rate_scale
Q = CONFIG.operating_point.dynamic_pressure


@pytest.fixture
def node() -> VehicleNode:
    return VehicleNode(NAMES, CONFIG)


class Commands:
    def __init__(self) -> None:
        self.sender = E2eSender(JET_COMMAND)

    def __call__(self, action: float, *, enable=True, mode=Mode.CONTROL, echo: int | None = 0, next_period=False):
        command = JetCommand(
            flow_m2_per_s=action * SCALE, mode=mode, enable=enable, pressure_counter=echo, next_period=next_period
        )
        return self.sender.frame(codec.emit_jet_command(command), now_ns=0)


def request(node: VehicleNode, *, wanted=True) -> Frame:
    return node.sample(np.zeros(sensors.COUNT), enable_request=wanted, now_ns=0)


@pytest.fixture
def trusted(node) -> Commands:
    """A stream of commands the node trusts, while it wants control; Pressure 0 is the only one it has sent."""
    request(node)
    commands = Commands()
    for _ in range(3):
        node.apply_commands([commands(0.0)])
    return commands


def parsed(frame: Frame) -> Pressure:
    message = codec.parse_pressure(frame.data)
    assert message is not None
    return message


def test_pressures_are_the_named_sensors_in_pascal(node):
    cp = np.linspace(-2.0, 1.0, sensors.COUNT)
    frame = node.sample(cp, enable_request=True, now_ns=40)
    message = parsed(frame)
    expected = [cp[sensors.NAMES.index(name)] * Q for name in NAMES]
    assert message.pressure_pa == pytest.approx(expected, abs=0.0501)  # half a step of 0.1 Pa
    assert (message.valid, message.enable_request, message.age_ns) == ((True,) * 4, True, 0)
    assert frame.timestamp_ns == 40
    assert not parsed(node.sample(cp, enable_request=False, now_ns=41)).enable_request
    assert node.frames_sent == 2


def test_a_pressure_out_of_range_saturates_and_is_marked_from_the_very_end_of_the_range_on(node):
    for pressure_pa in (3276.8, -3276.8, 1e6, float("inf"), float("nan")):
        cp = np.full(sensors.COUNT, 0.3)
        cp[sensors.NAMES.index("upper_00")] = pressure_pa / Q
        message = parsed(node.sample(cp, enable_request=True, now_ns=0))
        assert message.valid == (True, False, True, True), pressure_pa
        # One that is no number is sent as 0; half a step.
        sent = 0.0 if np.isnan(pressure_pa) else np.sign(pressure_pa) * 3276.7
        assert message.pressure_pa == pytest.approx([0.3 * Q, sent, 0.3 * Q, 0.3 * Q], abs=0.0501)
    # At a dynamic pressure of 512 Pa, a power of two, products and quotients are exact.
    node = VehicleNode(NAMES, replace(CONFIG, operating_point=OperatingPoint(speed=32.0, density=1.0)))
    limit = message_set(CONFIG.bus).pressure_limit_pa
    for sign in (1.0, -1.0):
        for pressure_pa, valid in ((sign * limit, True), (sign * np.nextafter(limit, np.inf), False)):
            cp = np.full(sensors.COUNT, pressure_pa / 512.0)
            assert parsed(node.sample(cp, enable_request=True, now_ns=0)).valid == (valid,) * 4


@each("hold", [0, 1, 2])
def test_missing_commands_hold_and_then_shut(hold):
    node, commands = VehicleNode(NAMES, Config(ecu=EcuConfig(hold_periods=hold))), Commands()
    request(node)
    *_, full = [node.apply_commands([commands(0.05)]).action for _ in range(3)]
    driven = [node.apply_commands([]) for _ in range(4)]
    assert [item.action for item in driven] == [full] * hold + [0.0] * (4 - hold)
    assert {(item.command, item.sampled_ns) for item in driven} == {(None, None)}


@given(st.sampled_from([16, 256]), st.lists(st.tuples(st.integers(1, 3), st.integers(0, 3)), max_size=400))
def test_every_honest_echo_has_its_frames_age_and_one_of_a_frame_that_was_not_sent_has_none(period, events):
    """As if numbered without end: an ECU that echoes the newest frames, some of them late, none twice out of order."""
    tracker, number, echoed = EchoTracker(counter_period=period), -1, -1
    assert tracker.received(0).age is None
    for frames, late in events:
        for _ in range(frames):
            number += 1
            tracker = tracker.sent(number % period, 1000 * number)
        echoed = max(echoed, number - late, 0)
        tracker = tracker.received(echoed % period)
        assert (tracker.age, tracker.sampled_ns) == (number - echoed, 1000 * echoed)
        ahead = tracker.received((number + 1) % period)
        assert (ahead.age, ahead.sampled_ns) == (None, None)
        # From the next one on it is followed again.
        assert ahead.received(number % period).age == 0


def test_a_command_drives_enabled_in_a_mode_that_does_and_on_pressures_alone(node, trusted):
    for mode in Mode:
        node.apply_commands([trusted(0.05)])
        driving = mode in (Mode.CONTROL, Mode.HOLD, Mode.DECAY)
        assert (node.apply_commands([trusted(0.05, mode=mode)]).action != 0.0) == driving, mode
        assert node.apply_commands([trusted(0.05, mode=mode, enable=False)]).action == 0.0, mode
    assert node.apply_commands([trusted(0.05)]).action != 0.0
    assert node.apply_commands([trusted(0.05, echo=None)]).action == 0.0
    # Nor without a request of its own; then it does not hold either.
    assert node.apply_commands([trusted(0.05)]).action != 0.0
    request(node, wanted=False)
    assert [node.apply_commands(frames).action for frames in ([trusted(0.05)], [])] == [0.0, 0.0]


@each("frames", ["fd", "classic"])
def test_an_echo_that_stands_still_drives_for_as_long_as_pressures_may_be_old_and_never_again(frames):
    """Past the end of the counter as well, which is sixteen frames away with classic CAN."""
    config = Config(bus=BusConfig(frames=frames))
    node, messages = VehicleNode(NAMES, config), message_set(config.bus)
    sender, driven = E2eSender(messages.command.spec), []
    command = JetCommand(flow_m2_per_s=2.0, mode=Mode.CONTROL, enable=True, pressure_counter=1)
    for _ in range(600):
        request(node)
        driven.append(node.apply_commands([sender.frame(messages.command.emit(command), now_ns=0)]).action != 0.0)
    # Period 0: no frame, and no trust. Then a hold, two decays, the frame's own period, one for computing and the way.
    assert driven == [False] + [True] * 6 + [False] * 593


def driven_through(node: VehicleNode, commands: Commands, came: Iterable[bool]) -> list[bool]:
    """Whether the jets moved, in periods with a command and without; the request for control stands."""
    moved = []
    for k, comes in enumerate(came):
        frame = request(node)
        # Each rests on the newest pressures.
        command = commands(0.05, echo=PROFILE_5.counter_of(frame.data))
        moved.append(node.apply_commands([command] if comes else []).action != 0.0)
        assert parsed(frame).enable_request or not any(moved[k:])
    return moved


def in_control(config: Config) -> tuple[VehicleNode, Commands]:
    node, commands = VehicleNode(NAMES, config), Commands()
    assert all(driven_through(node, commands, [True] * 60)[1:])
    return node, commands


@given(st.lists(st.booleans(), max_size=40), st.integers(1, 6), st.integers(1, 8))
@examples(60)
def test_control_ends_exactly_when_so_many_of_the_latest_periods_were_lost(came, limit, window):
    limit = min(limit, window)
    # A stream that pauses is judged again, which takes frames that count as lost: here the pattern alone counts.
    bus = replace(CONFIG.bus, e2e=replace(CONFIG.bus.e2e, max_delta=127, min_ok=1))
    node, commands = in_control(replace(CONFIG, bus=bus, vehicle=VehicleConfig(loss_window=window, loss_limit=limit)))
    lost = [not comes for comes in came]
    given_up = any(sum(lost[max(0, k + 1 - window) : k + 1]) >= limit for k in range(len(lost)))
    driven_through(node, commands, came)
    assert node.has_given_up == given_up


def test_control_given_up_comes_back_only_after_the_request_was_low_once():
    node, commands = in_control(CONFIG)
    driven_through(node, commands, [True, False] * 25)
    assert node.has_given_up
    # Whatever the ECU sends, and however long; on the bus the request is low.
    assert not any(driven_through(node, commands, [True] * 300))
    assert not parsed(request(node)).enable_request
    request(node, wanted=False)
    assert not node.has_given_up
    assert driven_through(node, commands, [True, True]) == [True, True]
    assert parsed(request(node)).enable_request


def test_commands_missing_while_the_ecu_has_no_control_do_not_count():
    """Before it is there, and while it is off or has latched a fault."""
    node, commands = VehicleNode(NAMES, CONFIG), Commands()
    driven_through(node, commands, [False] * 100)
    for mode in (Mode.OFF, Mode.FAULT):
        for _ in range(3):
            request(node)
            node.apply_commands([commands(0.0, enable=False, mode=mode, echo=None)])
        driven_through(node, commands, [False] * 100)
    assert not node.has_given_up


def test_the_jets_follow_within_their_step_and_after_their_delay():
    slow, late = VehicleConfig(action_step=0.04), VehicleConfig(actuator_delay=2)
    ahead = [(0.0, True)] * 3 + [(0.04, True), (0.04, True), (0.0, True), (-0.04, False), (-0.04, True), (-0.07, True)]
    for vehicle, wanted, expected in (
        (slow, [0.0, 0.0, 0.07, 0.07, *[-0.07] * 4], [0.0, 0.0, 0.04, 0.07, 0.03, -0.01, -0.05, -0.07]),
        # Planned ahead: in the third last period 0.0 was to be reached, and -0.04 is wanted at once: 0.08 in all.
        (slow, ahead, [0.0] * 4 + [0.04, 0.04, 0.0, 0.0, -0.04]),
        # The first frame only makes the stream known.
        (late, [0.0, 0.01, -0.02, 0.03, 0.0], [0.0, 0.0, 0.0, 0.01, -0.02]),
    ):
        node, commands = VehicleNode(NAMES, replace(CONFIG, vehicle=vehicle)), Commands()
        request(node)
        pairs = [one if isinstance(one, tuple) else (one, False) for one in wanted]
        driven = [node.apply_commands([commands(action, next_period=after)]).action for action, after in pairs]
        # Flows have steps of 0.0002 m2/s on the wire.
        assert driven == pytest.approx(expected, abs=2e-6), expected
        if vehicle is slow:  # shutting is never slowed down
            assert node.apply_commands([commands(-0.07, enable=False)]).action == 0.0


def test_jets_that_were_stuck_go_on_with_the_latest_commands():
    node, commands = VehicleNode(NAMES, replace(CONFIG, vehicle=VehicleConfig(actuator_delay=2))), Commands()
    driven = []
    for period in range(9):
        request(node, wanted=period < 5)
        node.stuck_at = 0.05 if 3 <= period < 7 else None
        driven.append(node.apply_commands([commands(0.03, echo=period)]).action)
    assert driven == pytest.approx([0.0] * 3 + [0.05] * 4 + [0.0] * 2, abs=2e-6)


def test_with_a_key_forged_and_replayed_commands_drive_nothing():
    key, another = Key(b"the nodes' secret"[:16]), Key(b"an attacker's own"[:16])
    config = Config(bus=BusConfig(key="key"))
    node = VehicleNode(NAMES, config, authentication=Authentication(key=key))
    messages = message_set(config.bus)
    spec = messages.command.spec

    def driven(count: int, used: Key, *, age: int = 0) -> float:
        request(node)
        command = JetCommand(flow_m2_per_s=2.0, mode=Mode.CONTROL, enable=True, pressure_counter=(count - age) % 256)
        sender = SenderState(counter=(count - age) % profile_of(spec).counter_period)
        plain = protected_frame(sender, messages.command.emit(command), spec=spec, now_ns=0)
        return node.apply_commands([secured(plain, spec=spec, key=used, freshness=Freshness(count=count - age))]).action

    assert all([driven(count, key) for count in range(300)][-200:])
    assert not any([driven(count, another) for count in range(300, 310)][2:])
    # Of 256 periods ago, with the same counter and echo.
    assert not any(driven(count, key, age=256) for count in range(310, 320))
    assert node.frames_not_authentic == node.frames_rejected == 20
