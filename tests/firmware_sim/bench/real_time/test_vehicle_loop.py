"""The vehicle's side in real time, on a clock of the test's; a recording as its flow."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire import codec
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import VEHICLE_SPEED
from can_bridge.wire.messages import Mode
from contract.config.tree import Config
from contract.errors import BusError, DatasetError
from contract.recording.dataset import Dataset
from contract.recording.episode import Episode, Role
from contract.sensors import COUNT, TRUCK
from ecu.ecu import Ecu
from ecu.real_time.deadlines import Deadlines
from ecu.real_time.inbox import Inbox
from ecu.real_time.stage_times import NOTHING, StageTimes, VehicleStage
from firmware_sim.bench.real_time.vehicle_loop import FAREWELL, UNSENT_LIMIT, Durations, Replay, VehicleLoop
from firmware_sim.bench.vehicle_node import VehicleNode
from tests.each import each
from tests.ecu.conftest import make_bundle
from tests.examples import examples
from tests.firmware_sim.bench.harness import NAMES, Harness, Oscillator, swinging

CONFIG, FIRST_NS = Config(), 7_000_000_000
PERIOD_NS = CONFIG.period_ns


def pressure_in(frame: Frame) -> Any:
    return codec.parse_pressure(frame.data)


class LiveOscillator:
    """The plant of two numbers as a flow in real time; without pressures in the periods `late`."""

    layout, description = TRUCK, "an oscillator"

    def __init__(self, substeps: int, late: frozenset[int] = frozenset()) -> None:
        self.plant, self.late, self.asked = Oscillator(substeps), late, -1
        self.driven: list[float] = []

    def sampled(self):
        self.asked += 1
        return None if self.asked in self.late else self.plant.sample().Cp

    def drive(self, action: float) -> None:
        self.driven.append(action)
        self.plant.advance_to(self.plant.substeps, action)


class MadeUpTime:
    """A vehicle's loop, an ECU whose command to each pressure frame arrives after `way_ns` of the frame's number, and
    the clock of both. Each sleep ends late by `lateness`, ns; on time when that is used up."""

    def __init__(self, way_ns=lambda number: 9_000_000, lateness=(), late_flow=frozenset(), stage_times=None):
        self.now_ns, self.way_ns, self.lateness = 0, way_ns, iter(lateness)
        self.ecu = Ecu(make_bundle(), swinging(), CONFIG)
        self.sent: list[tuple[int, Frame]] = []
        self.speeds: list[Frame] = []
        self.arriving: list[tuple[int, Frame]] = []
        self.is_taking = True
        self.flow = LiveOscillator(CONFIG.flow.substeps, late_flow)
        self.node = VehicleNode(NAMES, CONFIG)
        self.inbox = Inbox(lambda frame: self.now_ns, room=4096)
        deadlines = Deadlines(period_ns=PERIOD_NS, due_ns=FIRST_NS, grace_ns=PERIOD_NS // 2)
        clock: dict[str, Any] = {"now_ns": lambda: self.now_ns, "sleep_until": self.sleep_until}
        parts: Any = (self.node, self.flow, self.send, self.inbox, deadlines)
        self.loop = VehicleLoop(CONFIG, *parts, stage_times=stage_times, **clock)

    def sleep_until(self, due_ns: int) -> None:
        until_ns = max(due_ns, self.now_ns) + next(self.lateness, 0)
        self.arriving.sort(key=lambda item: item[0])
        while self.arriving and self.arriving[0][0] <= until_ns:
            self.now_ns, frame = self.arriving.pop(0)
            self.inbox.put(frame)
        self.now_ns = until_ns

    def send(self, frame: Frame) -> None:
        if not self.is_taking:
            raise BusError("frame 0x120 was not sent: made up")
        if VEHICLE_SPEED.names(frame):
            self.speeds.append(frame)
            return
        number = len(self.sent)
        self.sent.append((self.now_ns, frame))
        # The speed comes behind the pressures, and so is of the period before.
        answers = self.ecu.step(self.now_ns, [*self.speeds[-1:], frame])
        self.arriving += [(self.now_ns + self.way_ns(number), item) for item in answers]

    def run(self, periods: int) -> None:
        for k in range(periods):
            self.loop.period(enable_request=k >= 1)

    @property
    def instants(self) -> list[int]:
        """When pressures went out, in periods after the first instant, rounded down."""
        return [(at - FIRST_NS) // PERIOD_NS for at, _ in self.sent]


@examples(100)
@given(
    times=st.lists(st.integers(-5, 60_000_000) | st.just(10**15), min_size=1, max_size=60),
    share=st.sampled_from([0.01, 0.5, 0.99, 1.0]),
)
def test_quantiles_of_times_are_numpys_to_the_resolution(times: list[int], share: float) -> None:
    durations = Durations()
    for time in times:
        durations.add(time)
    # What is beyond the ends, 0 and 2 s, is kept at them.
    exact = np.quantile(np.clip(times, 0, 2 * 10**9), share, method="inverted_cdf") / 1e6
    assert exact - 0.01 < durations.quantile_ms(share) <= exact


def test_it_is_the_loop_in_virtual_time_to_the_bit() -> None:
    """With an ECU that plans ahead, the flow does not depend on when in a period its command comes."""
    virtual = Harness(8.0, plan_ahead=True)
    rows = virtual.run(40)
    for way_ms in (1.0, 9.0, 19.9):
        real = MadeUpTime(way_ns=lambda number, way_ms=way_ms: round(way_ms * 1e6))
        real.run(41)
        assert real.flow.driven[:40] == virtual.targets(), way_ms
        assert len(set(real.flow.driven)) > 20
        figures = real.loop.figures
        assert (figures.periods, figures.misses, figures.at_once, figures.left_out) == (41, 0, 0, 0), way_ms
        # The ECU needs a second frame before it trusts the stream, and so does the vehicle; none is lost later.
        assert figures.commands == 39
        assert figures.modes[Mode.CONTROL] == sum(row.mode == Mode.CONTROL for row in rows)


def test_a_command_is_of_the_period_it_arrives_in_however_late_the_process_wakes() -> None:
    # Command 20 arrives 1 ms after the boundary; the process wakes 3 ms after it, and finds it in the inbox.
    real = MadeUpTime(lambda number: 21_000_000 if number == 20 else 9_000_000, [0] * 21 + [3_000_000])
    real.run(22)
    assert real.loop.figures.misses == 1
    assert real.loop.figures.commands == 19


@each("periods_late, lost", [(0.7, 1), (2.3, 2), (2.7, 3)])
def test_an_instant_that_was_slept_past_is_left_out_and_never_caught_up(periods_late, lost) -> None:
    # The tenth, and those after it that are more than half a period ago.
    real = MadeUpTime(lateness=[0] * 10 + [round(periods_late * PERIOD_NS)])
    real.run(15)
    assert real.instants == [*range(10), *range(10 + lost, 15 + lost)]
    assert real.loop.figures.left_out == lost
    kept = zip(real.instants[11:], real.sent[11:], strict=True)
    assert all(at == FIRST_NS + k * PERIOD_NS for k, (at, _) in kept)


def test_a_live_wake_that_is_late_leaves_its_instant_without_pressures_and_the_end_waits_for_it() -> None:
    real = MadeUpTime(late_flow=frozenset({20, 21, 30, 32}))
    real.run(30)
    assert real.loop.figures.unsampled == 2
    assert real.instants == [k for k in range(30) if k not in (20, 21)]
    # No one drives a wake that is still busy.
    assert len(real.flow.driven) == 28
    real.loop.finish()
    assert real.instants[-FAREWELL:] == [31, 33, 34]


def test_the_end_withdraws_the_request_and_shuts_the_jets() -> None:
    real = MadeUpTime()
    real.run(20)
    before = real.loop.figures.periods, len(real.sent)
    real.loop.finish()
    requests = [pressure_in(frame).enable_request for _, frame in real.sent]
    assert requests[1:] == [True] * (before[1] - 1) + [False] * FAREWELL
    assert real.flow.driven[-FAREWELL:] == [0.0] * FAREWELL
    # The ECU has them all, and its own command is zero.
    assert real.ecu.trace.action == 0.0
    assert real.loop.figures.periods == before[0]
    assert real.loop.figures.commands == 19


def test_a_pause_for_longer_than_a_frame_can_state_leaves_its_instant_out() -> None:
    real = MadeUpTime()
    real.run(5)
    sampled, send = real.flow.sampled, real.send

    def pause(result: Any) -> Any:
        real.now_ns += 700_000_000
        return result

    real.flow.sampled = lambda: pause(sampled())  # type: ignore[method-assign]
    real.run(1)
    real.flow.sampled = sampled  # type: ignore[method-assign]
    assert (real.loop.figures.unsampled, len(real.sent), len(real.speeds)) == (1, 5, 5)
    real.loop._send = lambda frame: pause(send(frame))
    real.run(1)
    assert (real.loop.figures.unsampled, len(real.sent), len(real.speeds)) == (1, 6, 5)


def test_a_bus_that_takes_nothing_is_lost_after_a_second() -> None:
    real = MadeUpTime()
    real.run(10)
    real.is_taking = False
    real.run(UNSENT_LIMIT - 1)
    assert real.loop.figures.unsent == UNSENT_LIMIT - 1
    with pytest.raises(BusError, match=r"0x120 was not sent: made up; 49 earlier frames were not sent either"):
        real.run(1)


def test_stage_times_are_of_each_period() -> None:
    times = StageTimes(VehicleStage, 10)
    # The command to frame 6 comes a period late; the flow has nothing in period 8.
    late = [0] * 4 + [1_500_000], frozenset({8})
    real = MadeUpTime(lambda number: 30_000_000 if number == 6 else 9_000_000, *late, stage_times=times)
    real.run(10)
    real.loop.finish()
    # Counted in steps of 10 us: of the command that was late to be looked at, too.
    assert real.loop.figures.ages.quantile_ms(1.0) == pytest.approx(10.5, abs=0.011)
    column = {stage: times.rows()[:, stage] for stage in VehicleStage}
    assert column[VehicleStage.PERIOD].tolist() == list(range(10))
    scheduled = FIRST_NS + PERIOD_NS * np.arange(10)
    assert np.array_equal(column[VehicleStage.SCHEDULED], scheduled)
    assert (column[VehicleStage.SAMPLED] - scheduled)[[3, 4, 5]].tolist() == [0, 1_500_000, 0]
    assert column[VehicleStage.SAMPLED][8] == column[VehicleStage.SENT][8] == 0
    assert column[VehicleStage.PRESSURE_COUNTER].tolist() == [0, 1, 2, 3, 4, 5, 6, 7, NOTHING, 8]
    came = column[VehicleStage.COMMAND_ARRIVED]
    # The first command is not trusted yet; that of frame 6 misses its period, and comes with the next one.
    assert (came == 0).tolist() == [True, False, False, False, False, False, True, False, True, False]
    assert (came - scheduled)[[1, 4, 5]].tolist() == [9_000_000, 10_500_000, 9_000_000]
    assert column[VehicleStage.ECHOED_COUNTER][[1, 4, 5, 9]].tolist() == [1, 4, 5, 8]
    actuated = column[VehicleStage.ACTUATED]
    assert np.array_equal(actuated[[1, 2, 5]], scheduled[[1, 2, 5]] + PERIOD_NS)
    assert ((actuated == 0) == (came == 0)).all()


def episode(name: str, role: Role, steps: int, base: float) -> Episode:
    t = 0.2 * np.arange(steps)
    cp = base + np.arange(steps)[:, None] + 0.001 * np.arange(COUNT)
    series = {"t": t, "action": 0.0 * t, "Cp": cp, "Cd": t, "Cl": t}
    return Episode(name=name, role=role, series=series, initial_action=0.0, provenance={})


def test_rows_come_one_a_period_and_begin_again_whatever_the_jets_do() -> None:
    recorded = Dataset(episodes=(episode("round", "controlled", 9, 900.0), episode("sine", "train", 4, 100.0)))
    flow, rows = Replay(recorded, "sine"), []
    for _ in range(9):
        rows.append(flow.sampled())
        flow.drive(0.07)
    assert [row[0] for row in rows] == [*2 * [100.0, 101.0, 102.0, 103.0], 100.0]
    assert rows[0][5] == pytest.approx(100.005)
    # A recording under a controller is not taken unasked.
    assert Replay(recorded).sampled()[0] == 100.0
    assert Replay(recorded, "round").sampled()[0] == 900.0
    assert Replay(Dataset(episodes=recorded.episodes[:1])).sampled()[0] == 900.0
    # Nor a forced one, where the jets were at rest in another.
    forced = replace(recorded.episodes[1], series={**recorded.episodes[1].series, "action": np.ones(4)})
    assert Replay(Dataset(episodes=(forced, episode("none", "train", 4, 300.0)))).sampled()[0] == 300.0
    with pytest.raises(DatasetError, match="the data set has no episode 'chirp', only round, sine"):
        Replay(recorded, "chirp")
