"""What the ECU and the vehicle do about each fault of the bus between them, and that both recover.

Vehicle and ECU are the real ones; the plant is a constant pressure that counts up, so that what the controller is
given tells which frame it came from. Control is requested from period 2 on and stable from START on.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import pytest

from can_bridge.bus.faults.babble import Babble, keep_babbling
from can_bridge.bus.faults.connection import Disconnect, SlowConsumer
from can_bridge.bus.faults.content import FlipBits, StuckAt
from can_bridge.bus.faults.copies import Duplicate
from can_bridge.bus.faults.fault import Fault
from can_bridge.bus.faults.lateness import Delay
from can_bridge.bus.faults.loss import Drop
from can_bridge.bus.faults.wrapping import FaultyBus, wrap
from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE
from can_bridge.wire.messages import EcuStatus, Mode, Reason
from contract import sensors
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.errors import BusError
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.ecu.ecu import Ecu
from tests.each import each

AnyFault = TypeVar("AnyFault", bound=Fault)

NAMES = ("upper_39", "lower_39", "base_0", "base_9")
PERIOD_S = 0.02
START = 20
"""Period in which most faults begin: the loop is in control since period 9 at the latest."""
MS = 10**6


@dataclass(frozen=True)
class Period:
    """What one period came to."""

    mode: Mode
    reason: Reason
    status: EcuStatus
    commanded: float
    """By the ECU, U_inf W."""
    driven: float
    """By the vehicle."""
    sampled_ns: int | None
    """When the vehicle sampled the pressures behind the command, by the counter that is echoed."""


def during(fault: AnyFault, periods: int) -> AnyFault:
    """Begins and ends between two frames, so that so many periods are hit."""
    begin_s = (START - 0.1) * PERIOD_S
    return replace(fault, start_s=begin_s, end_s=begin_s + periods * PERIOD_S)


class Loop:
    """Vehicle and ECU on a simulated bus, each behind a wrapped port."""

    def __init__(self, bundle, controller, *, vehicle=(), ecu=(), seed=1) -> None:
        self.config = Config(ecu=EcuConfig(plan_ahead=False))
        self.bus = SimulatedBus(self.config.bus)
        self.vehicle: FaultyBus = wrap(self.bus.port("vehicle"), vehicle, lambda: self.bus.now_ns, seed=seed)
        self.ecu_port: FaultyBus = wrap(self.bus.port("ecu"), ecu, lambda: self.bus.now_ns, seed=seed + 1)
        self.node = VehicleNode(NAMES, self.config)
        self.controller = controller
        self.ecu = Ecu(bundle, controller, self.config)
        self.period = 0
        self.plans: list[tuple[int, int]] = []
        """(period, that of the pressures it rests on) of each plan."""
        self.withdrawn: set[int] = {0, 1}
        """Periods in which control is not requested."""

    def cp(self) -> np.ndarray:
        # Steps of 0.01 are two steps of the wire.
        return np.full(sensors.COUNT, 0.01 * self.period)

    def run(self, until: int) -> list[Period]:
        return [self.one() for _ in range(until - self.period)]

    def one(self) -> Period:
        begin_ns = self.period * self.config.period_ns
        self.bus.advance_to(begin_ns)
        requested = self.period not in self.withdrawn
        self.vehicle.send(self.node.sample(self.cp(), enable_request=requested, now_ns=begin_ns))
        self.bus.advance_to(begin_ns + 2 * MS)
        planned = len(self.controller.calls)
        received, health = self.ecu_port.receive_all(), self.ecu_port.health()
        answers = self.ecu.step(self.bus.now_ns, received, health)
        self.plans += [(self.period, round(window[-1, 0] / 0.01)) for window, _, _ in self.controller.calls[planned:]]
        self.bus.advance_to(begin_ns + 10 * MS)
        for frame in answers:
            with suppress(BusError):  # a bus that is too busy
                self.ecu_port.send(frame)
        self.bus.advance_to(begin_ns + self.config.period_ns - 1)
        commands = [frame for frame in self.vehicle.receive_all() if frame.frame_id == JET_COMMAND.frame_id]
        actuation = self.node.apply_commands(commands)
        status = self.ecu.status()
        self.period += 1
        return Period(
            mode=status.state,
            reason=status.reason,
            status=status,
            commanded=self.ecu.trace.action,
            driven=actuation.action,
            sampled_ns=actuation.sampled_ns,
        )


@pytest.fixture
def loop(bundle_of, recording_controller):
    def make(controller=None, **options):
        steps = iter(range(10**6))
        default = recording_controller(lambda i: 0.02 + 0.001 * (next(steps) % 7))
        return Loop(bundle_of(), controller or default, **options)

    return make


def modes(rows) -> list[Mode]:
    return [row.mode for row in rows]


def recovers(loop: Loop, *, rearmed: bool) -> None:
    """Good frames alone bring control back if nothing latched; else it takes a new request, and that is enough."""
    if rearmed:
        rows = loop.run(loop.period + 10)
        assert set(modes(rows)) == {Mode.FAULT}
        loop.withdrawn |= {loop.period, loop.period + 1}
    rows = loop.run(loop.period + 15)
    assert set(modes(rows[10:])) == {Mode.CONTROL}
    assert {row.reason for row in rows[10:]} == {Reason.NONE}
    assert all(row.driven == row.commanded != 0.0 for row in rows[10:])


@each(
    "lost, expected",
    [
        (1, [Mode.HOLD]),
        (2, [Mode.HOLD, Mode.DECAY]),
        (3, [Mode.HOLD, Mode.DECAY, Mode.DECAY]),
        (4, [Mode.HOLD, Mode.DECAY, Mode.DECAY, Mode.FAULT]),
        (9, [Mode.HOLD, Mode.DECAY, Mode.DECAY, *[Mode.FAULT] * 6]),
    ],
)
@each("fault", ["drop", "open wire"])
def test_lost_pressures_hold_decay_and_latch(loop, lost, expected, fault):
    faults = {
        "drop": during(Drop(probability=1.0, frame_ids=(PRESSURE.frame_id,)), lost),
        "open wire": during(Disconnect(), lost),
    }
    h = loop(vehicle=(faults[fault],))
    before = h.run(START)
    assert modes(before)[-5:] == [Mode.CONTROL] * 5
    last = h.ecu.trace.action
    rows = h.run(START + lost)
    assert modes(rows) == expected
    # The wire's step of the flow is 0.0002 m2/s, of 62.5.
    held = [last, last / 2, last / 4] + [0.0] * lost
    assert [row.commanded for row in rows] == pytest.approx(held[:lost], abs=0.0002 / 62.5)
    assert {row.reason for row in rows} == {Reason.STREAM_LOST}
    assert rows[-1].status.missed - before[-1].status.missed == lost
    recovers(h, rearmed=lost >= 4)


def test_copies_change_nothing_but_a_count(loop):
    plain, copied = loop(), loop(vehicle=(Duplicate(copies=2),), ecu=(Duplicate(),))
    rows = [h.run(60) for h in (plain, copied)]
    assert [replace(row, status=None) for row in rows[0]] == [replace(row, status=None) for row in rows[1]]
    assert (rows[0][-1].status.refused, rows[1][-1].status.refused) == (0, 120)


def test_flips_ahead_of_the_protection_are_planned_on(loop):
    """End-to-end protection cannot see them: another pressure than the sender had is what the controller gets."""
    # Bit 4 of the flags and the spare ones are not pressures; the seed gives a run in which some hit a pressure.
    h = loop(vehicle=(during(FlipBits(before_crc=True, frame_ids=(PRESSURE.frame_id,)), 20),))
    rows = h.run(START + 20)
    assert rows[-1].status.crc_errors == rows[-1].status.refused == 0
    wrong = [window[-1, :4] for window, _, _ in h.controller.calls if len(set(np.round(window[-1, :4], 4))) > 1]
    assert len(wrong) > 5


def test_frozen_pressures_under_a_running_counter_are_planned_on(loop):
    h = loop(vehicle=(during(StuckAt(counter_runs=True, frame_ids=(PRESSURE.frame_id,)), 30),))
    rows = h.run(START + 40)
    assert set(modes(rows[START:])) == {Mode.CONTROL}
    rest = [seen for period, seen in h.plans if period >= START]
    assert rest == [START] * 30 + list(range(START + 30, START + 40))


@each("restamp", [True, False])
def test_a_delay_is_seen_where_the_stamp_tells_of_it(loop, restamp):
    """Frames two periods late: a gateway's cannot be told from fresh ones, a queue's behind the stamp can."""
    h = loop(ecu=(Delay(delay_s=2 * PERIOD_S, restamp=restamp, start_s=(START - 0.1) * PERIOD_S, end_s=1.5),))
    h.run(START)
    rows = h.run(START + 30)
    assert modes(rows[:2]) == [Mode.HOLD, Mode.DECAY]  # nothing comes
    if restamp:
        assert set(modes(rows[2:])) == {Mode.CONTROL}
        assert h.plans[-28:] == [(k + 2, k) for k in range(START, START + 28)]
        # The vehicle sees it: the echoed counter is of the frame of two periods ago.
        assert [row.sampled_ns for row in rows[2:]] == [k * h.config.period_ns for k in range(START, START + 28)]
    else:
        assert modes(rows[2:4]) == [Mode.DECAY, Mode.FAULT]
        assert rows[-1].reason is Reason.STALE
        assert [row.commanded for row in rows[3:]] == [0.0] * 27
    h.run(80)
    recovers(h, rearmed=not restamp)


def test_a_slow_consumer_plans_on_nothing_old(loop):
    """Nothing but pressures and babble arrives; one frame a period is taken, so the pressures wait and grow old."""
    babble = during(Babble(rate_hz=100.0, frame_id=0x100), 40)
    slow = during(SlowConsumer(frames_per_call=1, queue=16), 40)
    h = loop(vehicle=(babble,), ecu=(slow,))
    h.run(START)
    rows = h.run(START + 40)
    assert rows[-1].mode is Mode.FAULT
    assert h.ecu_port.injectors[0].acted > 0
    # The oldest pressures that may be planned on are 1.5 periods old.
    assert {period - seen for period, seen in h.plans} <= {0, 1}
    recovers(h, rearmed=True)


def test_a_babbling_node_shuts_the_jets_at_both_ends(loop):
    h = loop()
    babble = during(Babble(), 10)
    keep_babbling(wrap(h.bus.port("babbler"), (babble,), lambda: h.bus.now_ns), h.bus)
    h.run(START)
    rows = h.run(START + 10)
    assert modes(rows) == [Mode.HOLD, Mode.DECAY, Mode.DECAY, *[Mode.FAULT] * 7]
    assert rows[-1].reason is Reason.STREAM_LOST
    # Nothing gets through to the vehicle either.
    assert [row.driven for row in rows[1:]] == [0.0] * 9
    recovers(h, rearmed=True)
