"""The ECU in C and the Python ECU side by side: the same frames, times and answers of the networks, to the bit."""

from collections import Counter
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.e2e.profiles import profile_of
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import Pressure
from tests.each import each
from tests.examples import examples
from tests.proofs.ecu_in_c import campaign
from tests.proofs.ecu_in_c.edges import Edges
from tests.proofs.ecu_in_c.library import Layout, Library, sources
from tests.proofs.ecu_in_c.planted import PLANTED
from tests.proofs.ecu_in_c.python_twin import Answers, Period, PythonTwin
from tests.proofs.ecu_in_c.traffic import EDGES, FAULTS, Traffic
from tests.proofs.ecu_in_c.variants import VARIANTS

pytestmark = pytest.mark.compiler
PERIODS = 1_000
"""Of each stretch; the benchmark `ecu-c` lives through a million in all."""


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """The library of a variant, by its name."""
    folder, built = tmp_path_factory.mktemp("twins"), dict[str, Library]()

    def get(name: str) -> Library:
        if name not in built:
            built[name] = campaign.build(name, folder)
        return built[name]

    return get


@each("seed", ["0", "1"])
@each("name", VARIANTS)
def test_both_ecus_live_through_the_same_periods_alike(library, name, seed):
    found = campaign.stretch(library(name), name, seed, PERIODS)
    assert found.mismatch is None, str(found.mismatch)
    assert found.steps == PERIODS


def test_the_traffic_reaches_every_mode_and_keeps_control_for_long():
    """Or nothing much would be compared."""
    modes = dict.fromkeys(("INIT", "STANDBY", "ARMED", "WARMUP", "ACTIVE", "HOLD", "DECAY", "FAULT", "UPDATE"), 0)
    for name in ("as shipped", "late actuator, long windows"):
        for seed in "01":
            twin = PythonTwin(VARIANTS[name], _layout(name))
            for mode, count in _modes_of(twin, name, seed).items():
                modes[mode] += count
    assert min(modes.values()) > 0
    assert modes["ACTIVE"] > 0.2 * sum(modes.values())


def _layout(name):
    return Layout(sources(VARIANTS[name]))


def _modes_of(twin, name, seed):
    modes = Counter[str]()
    rng = Random(seed)
    edges = Edges(VARIANTS[name], rng) if seed == "1" else None
    campaign.recorded(twin, campaign.traffic(name, seed, twin.horizon), 600, modes=modes, edges=edges, rng=rng)
    return modes


def test_the_same_seed_gives_the_same_bytes():
    layout = _layout("classic")
    assert campaign.recording("classic", "1", 60, layout) == campaign.recording("classic", "1", 60, layout)
    assert campaign.recording("classic", "1", 60, layout) != campaign.recording("classic", "3", 60, layout)


@pytest.mark.parametrize("planted", PLANTED, ids=lambda item: item.what)
def test_a_fault_that_is_planted_in_c_is_found(planted, tmp_path):
    contents = planted.into(sources(VARIANTS[planted.variant]))
    broken = Library(contents, tmp_path / "broken.so")
    found = (campaign.stretch(broken, planted.variant, seed, 2_000, chunk=100).mismatch for seed in "130")
    mismatch = next((item for item in found if item is not None), None)
    assert mismatch is not None
    assert mismatch.fields


def test_a_mismatch_says_where_it_is_and_happens_again(tmp_path):
    planted = PLANTED[1]
    broken = Library(planted.into(sources(VARIANTS[planted.variant])), tmp_path / "broken.so")
    first, again = (campaign.stretch(broken, planted.variant, "1", 400).mismatch for _ in range(2))
    assert first == again
    assert first is not None
    assert first.fields == ("state.command_counter: 0 in Python, 1 in C",)


# --- by hypothesis ---

NUMBERS = st.one_of(
    st.floats(width=32),
    st.sampled_from([float("nan"), float("inf"), -float("inf"), 0.0, -0.0, 3.4e38, -3.4e38, 0.15, -0.15]),
    st.floats(-0.25, 0.25, width=32),
)
PRESSURES = st.builds(
    Pressure,
    pressure_pa=st.tuples(*[st.floats(-2000, 2000)] * 4),
    valid=st.one_of(st.just((True,) * 4), st.tuples(*[st.booleans()] * 4)),
    enable_request=st.booleans(),
    age_ns=st.sampled_from([0, 10_000, 9_999_999, 10_000_000, 30_000_000, 70_000_000, 655_350_000]),
)
ELAPSED = st.one_of(
    st.just(20_000_000), st.just(20_000_000), st.integers(19_000_000, 21_000_000),
    st.sampled_from([0, 1, -1, 10_000_000, 10_000_001, 30_000_000, 29_999_999, 60_000_000, 10**9, -(10**9), 10**13]),
)  # fmt: skip


class BothEcus(RuleBasedStateMachine):
    """Whatever comes, both ECUs make the same of it. `library` is set by the test."""

    library: Library
    name = "quick to doubt"

    @initialize(seed=st.integers(0, 2**32 - 1))
    def power_on(self, seed):
        config = VARIANTS[self.name]
        self.twin = PythonTwin(config, self.library.layout)
        self.message = message_set(config.bus).pressure
        self.now_ns, self.counter, self.restarts = 10**12, 0, True
        self.edges = Edges(config, Random(seed))
        self.numbers = np.random.default_rng(seed)

    def _step(self, frames, **others):
        answers = others.pop("answers", None) or self._answers([0.01] * 5)
        period = Period(now_ns=self.now_ns, frames=frames, answers=answers, restarts=self.restarts, **others)
        self.restarts = False
        room = self.library.layout.periods(1)
        self.twin.live_through(period, room[0])
        same = self.library.run(room, 1)
        assert same == 1, self.library.layout.differences(room[0].response, self.library.found[0])

    def _answers(self, plan):
        estimates = self.numbers.normal(0.0, 0.1, (34, 4)).astype(np.float32).astype(np.float64)
        return Answers(plan=np.array(plan), forces=np.ones((5, 2)), estimates=estimates)

    def _frame(self, pressure, late_ns):
        spec, profile = self.message.spec, profile_of(self.message.spec)
        data = profile.protect(self.message.emit(pressure), data_id=spec.data_id, counter=self.counter)
        self.counter = (self.counter + 1) % profile.counter_period
        time_ns = max(0, min(2**63 - 1, self.now_ns - late_ns))
        return Frame(frame_id=spec.frame_id, data=data, timestamp_ns=time_ns, is_fd=spec.is_fd)

    @rule(periods=st.integers(1, 12), request=st.booleans(), value=st.floats(-300, 300))
    def calm(self, periods, request, value):
        for number in range(periods):
            self.now_ns += 20_000_000
            pressures = (value, value + number, -value, value - number)
            pressure = Pressure(pressure_pa=pressures, valid=(True,) * 4, enable_request=request, age_ns=0)
            self._step([self._frame(pressure, 1_000_000)])

    @rule(elapsed=ELAPSED, pressures=st.lists(PRESSURES, max_size=3), late_ns=st.integers(-5_000_000, 60_000_000))
    def any_frames(self, elapsed, pressures, late_ns):
        self.now_ns = max(-(2**63), min(2**63 - 1, self.now_ns + elapsed))
        self._step([self._frame(pressure, late_ns) for pressure in pressures])

    @rule(skip=st.integers(0, 20), data=st.binary(min_size=16, max_size=16))
    def a_broken_frame(self, skip, data):
        self.counter = (self.counter + skip) % profile_of(self.message.spec).counter_period
        self.now_ns += 20_000_000
        self._step([Frame(frame_id=self.message.spec.frame_id, data=data, timestamp_ns=max(0, self.now_ns))])

    @rule(plan=st.lists(NUMBERS, min_size=5, max_size=5), good=st.booleans(), pressure=PRESSURES)
    def any_plan(self, plan, good, pressure):
        self.now_ns += 20_000_000
        answers = self._answers(plan)
        self._step(
            [self._frame(pressure._replace(enable_request=True, valid=(True,) * 4, age_ns=0), 0)],
            answers=Answers(plan=answers.plan, forces=answers.forces, estimates=answers.estimates, is_planned=good),
        )

    @rule(now_ns=st.sampled_from(EDGES))
    def a_time_at_an_end(self, now_ns):
        before, self.now_ns = self.now_ns, now_ns
        self._step([])
        self.now_ns = before

    @rule(
        off=st.booleans(),
        counts=st.tuples(*[st.sampled_from([0, 1, 255, 256, 2**32 - 1])] * 3),
        fault=st.one_of(st.none(), st.sampled_from(FAULTS)),
        updating=st.booleans(),
    )
    def surroundings(self, off, counts, fault, updating):
        self.now_ns += 20_000_000
        state = BusState.BUS_OFF if off else BusState.ERROR_ACTIVE
        health = BusHealth(state=state, tx_errors=counts[0], rx_errors=counts[1], bus_off=counts[2])
        self._step([], health=health, fault=fault, updating=updating)

    @rule()
    def near_an_edge(self):
        self.now_ns += 20_000_000
        self._step([], loads=self.edges.near(self.twin.ecu.state, self.now_ns))

    @rule()
    def restart(self):
        self.restarts = True


@each("name", ["quick to doubt", "late actuator, long windows"])
def test_both_ecus_make_the_same_of_whatever_comes(library, name):
    machine: Any = type("Both", (BothEcus,), {"library": library(name), "name": name})
    test = machine.TestCase
    test.settings = examples(30, stateful_step_count=30, deadline=None)
    test().runTest()


def test_traffic_of_a_hostile_bus_has_frames_of_all_kinds():
    source = Traffic(VARIANTS["as shipped"], 5, "a")
    frames = [frame for _ in range(2_000) for frame in source.next().frames]
    assert any(frame.is_extended for frame in frames)
    assert {frame.is_fd for frame in frames} == {True, False}
    assert {0x120, 0x130, 0x140} <= {frame.frame_id for frame in frames}
    assert max(len(frame.data) for frame in frames) == 64
