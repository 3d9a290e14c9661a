"""The loop in virtual time: when a command takes effect, and what becomes of late, lost and damaged frames."""

from contextlib import suppress
from dataclasses import asdict, replace
from math import ceil, isnan

import numpy as np
import pytest

from can_bridge.bus.interface import BusHealth
from can_bridge.e2e.profiles import SenderState
from can_bridge.secoc.securing import VerifierState
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE, VEHICLE_SPEED
from can_bridge.wire.messages import Mode, Reason
from contract.errors import BusError
from ecu.ecu import Ecu
from tests.each import each
from tests.ecu.conftest import RecordingController, make_bundle
from tests.firmware_sim.bench.harness import INTERMISSION_NS, WARM, Harness


@each("ahead, compute_ms", [(ahead, ms) for ahead in (0, 1) for ms in (0.0, 8.0, 19.0)])
def test_the_command_is_the_target_of_the_period_it_is_computed_in_or_planned_ahead_of_the_next(ahead, compute_ms):
    h = Harness(compute_ms, plan_ahead=bool(ahead))
    rows = h.run(20)
    commands = [row.command for row in rows]
    assert h.targets()[WARM + ahead :] == commands[WARM : 20 - ahead]
    assert len(set(commands[WARM:])) == 20 - WARM
    # Sample k shows the action commanded at k - 1: the timing convention of the recordings.
    assert [row.sample.action for row in rows[WARM + 1 + ahead :]] == commands[WARM : 19 - ahead]
    assert [row.sample.t for row in rows] == pytest.approx(0.2 * np.arange(20))
    assert {row.mode for row in rows[WARM:]} == {Mode.CONTROL}
    assert not ahead or set(h.starts().values()) == {0}


@each("compute_ms", [0.0, 0.5, 8.0, 19.0, 19.5])
def test_the_ramp_starts_in_the_substep_after_the_command_arrives(compute_ms):
    h = Harness(compute_ms)
    rows = h.run(12)
    period_ns, compute_ns = h.config.period_ns, round(compute_ms * 1e6)
    # The speed behind the pressures is over before the command is ready, unless it takes no time.
    speeds = [2 * INTERMISSION_NS + taken if compute_ns == 0 else compute_ns for taken in h.taken(VEHICLE_SPEED)]
    arrivals = [sum(taken) for taken in zip(h.taken(PRESSURE), speeds, h.taken(JET_COMMAND), strict=True)]
    assert max(arrivals) < period_ns
    assert h.ends(JET_COMMAND) == [k * period_ns + after for k, after in enumerate(arrivals)]
    # Frame times count even if computing takes none; the last substep is left for the ramp.
    expected = [min(ceil(after / (period_ns / 30)), 29) for after in arrivals]
    assert min(expected) >= 1
    assert [h.starts()[k] for k in range(WARM, 12)] == expected[WARM:]
    assert [row.age_ms for row in rows[WARM:]] == pytest.approx([after / 1e6 for after in arrivals[WARM:]])


@each("compute_ms", [19.83, 19.9])
def test_a_command_that_misses_its_period_acts_in_the_next(compute_ms):
    """It is on the bus across the period's end, or sent after it."""
    h = Harness(compute_ms)
    rows = h.run(16)
    compute_ns, period_ns = round(compute_ms * 1e6), h.config.period_ns
    handed_over = [k * period_ns + taken + compute_ns for k, taken in enumerate(h.taken(PRESSURE))]
    # It waits for the pressures of the next period when it is handed over in the same instant or later.
    assert {at % period_ns > period_ns // 2 for at in handed_over} == {compute_ms == 19.83}
    assert h.targets()[WARM + 1 :] == [row.command for row in rows[WARM:-1]]
    arrivals = [end - (k + 1) * period_ns for k, end in enumerate(h.ends(JET_COMMAND))]
    assert min(arrivals) > 0
    assert [h.starts()[k] for k in range(WARM + 1, 16)] == [ceil(a * 30 / period_ns) for a in arrivals[WARM:15]]
    # The age is that of the pressures behind the command, not of the period's own.
    expected = [(period_ns + after) / 1e6 for after in arrivals[WARM:15]]
    assert [row.age_ms for row in rows[WARM + 1 :]] == pytest.approx(expected)
    assert h.ecu.status().overruns == 0
    assert h.loop.totals().lost == 0
    # Planned ahead, it acts in the period after that in which it arrives.
    h = Harness(compute_ms, plan_ahead=True)
    rows = h.run(16)
    assert min(end - (k + 1) * period_ns for k, end in enumerate(h.ends(JET_COMMAND))) > 0
    assert h.targets()[WARM + 2 :] == [row.command for row in rows[WARM:-2]]


@each("compute_ms, every", [(19.95, 1), (20.05, 2), (25.0, 2), (41.0, 3)])
def test_an_ecu_that_is_too_slow_skips_steps_and_loses_no_frame(compute_ms, every):
    # Frames differ by some 10 us in stuff bits, so that an ECU that takes 20 ms does and does not keep up.
    h = Harness(compute_ms, hold_periods=3, deadline_misses=1000)
    rows = h.run(31)
    stepped = [k for k, row in enumerate(rows) if not isnan(row.step_ms)]
    assert stepped == list(range(0, 31, every))
    skipped = [row for row in rows if isnan(row.step_ms)]
    assert all(isnan(row.command) and isnan(row.predicted_Cd) for row in skipped)
    assert h.ecu.status().overruns == (every - 1) * (len(stepped) - 1)
    assert rows[-1].mode == Mode.CONTROL
    totals = h.loop.totals()
    assert (totals.lost, totals.rejected) == (0, 0)
    for extra in range(1, every + 1):  # whatever is under way when one looks
        h.run(1)
        assert h.loop.totals().lost == 0
        assert h.loop.totals().sent > totals.sent, extra
    assert min(row.age_ms for row in rows[-8:] if not isnan(row.age_ms)) > compute_ms


def test_pressures_that_wait_for_the_bus_make_the_step_late_and_no_miss():
    """Frames of higher priority, twelve of 390 us, handed over at once when the period begins."""
    h = Harness(8.0)
    port = h.bus.port("other")
    data = b"\x55" * 64

    def crowd() -> None:
        for _ in range(12):
            port.send(Frame(frame_id=0x001, data=data))

    h.bus.call_at(10 * h.config.period_ns, crowd)
    rows = h.run(13)
    wait_ns = 12 * h.bus.frame_ns(Frame(frame_id=0x001, data=data))
    assert wait_ns < h.config.period_ns // 2
    assert h.ends(PRESSURE)[10] == 10 * h.config.period_ns + wait_ns + h.taken(PRESSURE)[10]
    assert h.ecu.status().missed == 1  # the first frame
    assert {row.mode for row in rows[WARM:]} == {Mode.CONTROL}
    assert rows[10].age_ms - rows[9].age_ms == pytest.approx(wait_ns / 1e6, abs=0.03)  # contents differ in stuff bits
    assert h.starts()[10] > h.starts()[9]
    assert h.loop.totals().lost == 0


def faulty(fault: str, compute_ms: float = 8.0) -> Harness:
    pressures, commands = PRESSURE.frame_id, JET_COMMAND.frame_id
    return Harness(compute_ms, f"vehicle:{fault},frame_ids={pressures}", f"ecu:{fault},frame_ids={commands}")


def test_frames_that_are_dropped_are_lost_and_damaged_ones_rejected_by_their_receiver():
    for fault, counted in (("drop", "lost"), ("flip_bits", "rejected")):
        rows = (h := faulty(f"{fault}:probability=0.15")).run(60)
        pressures, commands = (one.acted for one in h.disturbing.injected())
        assert min(pressures, commands) > 3
        assert h.ecu.status().crc_errors == (pressures if counted == "rejected" else 0)
        h.loop.reset_ecu(0)  # the totals are of the whole run
        assert asdict(h.loop.totals()) == {"sent": 120, "lost": 0, "rejected": 0, counted: pressures + commands}
        # A period whose command was dropped has no age, and the jets hold.
        assert sum(isnan(row.age_ms) for row in rows) >= commands
    # Copies of other frames hide no loss.
    (h := Harness(8.0, "vehicle:duplicate", f"ecu:drop:probability=0.15,frame_ids={JET_COMMAND.frame_id}")).run(60)
    assert h.loop.totals().lost == h.disturbing.injected()[1].acted > 3
    # Those that come while the ECU is busy are checked too: it steps in every other period, the last included.
    h = faulty("flip_bits:probability=0.3", compute_ms=25.0)
    h.run(61)
    assert h.ecu.status().crc_errors == h.disturbing.injected()[0].acted > 8


def test_a_reset_keeps_freshness_and_the_can_controllers_counts_alone():
    h = Harness(8.0)
    h.run(20)
    state, health = h.ecu.state, BusHealth(bus_off=1)
    speed = replace(state.speed, verifier=VerifierState(freshness=8))
    h.ecu.restore(replace(state, verifier=VerifierState(freshness=7), speed=speed, health=health))
    h.loop._ecu_health = lambda: health
    h.loop.reset_ecu(0)
    after = h.ecu.state
    assert (after.verifier.freshness, after.speed.verifier.freshness, after.missed) == (7, 8, 0)
    assert {row.mode for row in h.run(5)} == {Mode.OFF}


@each("counters_apart", [0, 1, 3, 128])
def test_two_ecus_that_hear_each_other_shut_the_jets(counters_apart):
    """Whichever of the two streams the vehicle's end-to-end check would have followed."""
    h = Harness(1.0)
    other, port = Ecu(make_bundle(), RecordingController(), h.config), h.bus.port("other ECU")
    other.restore(replace(other.state, commands=SenderState(counter=counters_apart)))

    def step() -> None:
        for frame in other.step(h.bus.now_ns, port.receive_all(), port.health()):
            with suppress(BusError):  # bus-off
                port.send(frame)
        h.bus.call_at(h.bus.now_ns + h.config.period_ns, step)

    h.bus.call_at(3_000_000, step)
    h.run(60)
    assert h.targets() == [0.0] * 60
    for ecu in (h.ecu, other):
        assert (ecu.status().state, ecu.status().reason) == (Mode.FAULT, Reason.OTHER_ECU)


def test_a_damaged_command_on_the_bus_is_no_second_ecu():
    h = Harness(1.0)
    noise = h.bus.port("noise")
    for _ in range(30):
        noise.send(Frame(frame_id=JET_COMMAND.frame_id, data=bytes(JET_COMMAND.length), is_fd=True))
        h.run(1)
    assert h.ecu.status().reason is not Reason.OTHER_ECU
