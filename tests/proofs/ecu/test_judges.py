"""The judges of the hostile bus find each defect that is planted, and none where there is none: in no story that
hypothesis can think of.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.command_gate import GatedCommand, Intervention
from can_bridge.e2e.profiles import SenderState
from can_bridge.wire.messages import Reason
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig, VehicleConfig
from ecu import controller_memory, ecu, ecu_state, fail_safe
from ecu.ecu_state import EcuState
from ecu.fail_safe import FailSafe, OperatingMode
from ecu.pressure_reception import PressureReception
from ecu.timing import StepTiming
from firmware_sim.bench.vehicle_node import EchoTracker, VehicleNode
from tests.examples import examples
from tests.proofs.ecu import hostile, hostile_world
from tests.proofs.ecu.hostile_world import CALM, Events, RandomEvents, World
from tests.proofs.ecu.promises import PROMISES

CONFIG = Config()
SWINGS = [Events(value=value) for value in (0.15, -0.15) * 3]
LOST = [Events(pressure="lost")] * 5
HALF_LOST = [Events(pressure="lost" if k % 2 else "pass") for k in range(70)]  # none in a row
OLD = [*[Events(command="late3")] * 12, *[Events(command="late3", pressure="lost")] * 3, *[Events(command="late3")] * 5]
"""Commands come three periods late, and then rest on pressures of three periods before them."""
STORIES = {
    "exceptions": [Events(deed="memory")],
    "frames": [],
    "bounds": [Events(value=0.15)] * 3,
    "rate": SWINGS,
    "shut unless active": [],
    "clock": [Events(elapsed_ns=0), Events(elapsed_ns=-1)],
    "bus-off": [Events(bus_off=True, unseen=True)],
    "controller": [Events(deed="nan")],
    "fresh pressures": [Events(queued_ns=35_000_000)],
    "held pressures": LOST,
    "loss limits": LOST,
    "re-arming": [*LOST, *[Events(request=False)] * 3, Events()],
    "power-on": [Events(reset_ecu=True), *[Events()] * 6],
    "reasons": LOST,
    "counts": LOST,
    "vehicle: bounds": [Events(value=0.15)] * 3,
    "vehicle: rate": SWINGS,
    "vehicle: request": [Events(request=False)],
    "vehicle: loss limits": [Events(command="lost" if k % 2 else "pass") for k in range(60)],
    "vehicle: doubt": [Events(command="lost")] * 4,
}
"""What happens, in control, that a defect needs to be seen, by promise."""


def broken_in(world: World, story: list[Events]) -> set[str]:
    return {name for events in [*CALM, *story] for name in world.period(events)}


@pytest.mark.slow  # stories and chance in every kind of settings
def test_nothing_is_broken_as_it_is():
    for name, settings in hostile.SETTINGS.items():
        for story in (*STORIES.values(), OLD):
            assert broken_in(World(Config(ecu=settings)), story) == set(), (name, story)
        for hostility in (0.03, 0.3):
            world, events = World(Config(ecu=settings)), RandomEvents(1, hostility)
            for _ in range(40):
                assert world.period(events.next(world.now_ns)) == [], (name, hostility, world.seen)
    assert broken_in(World(CONFIG), HALF_LOST) == set()


LAX = (
    (replace(CONFIG, ecu=EcuConfig(command_step=0.15)), "rate"),
    (replace(CONFIG, ecu=EcuConfig(pressure_age=4.0)), "fresh pressures"),
    (replace(CONFIG, ecu=EcuConfig(decay_periods=4)), "loss limits"),
    (replace(CONFIG, ecu=EcuConfig(rearm_frames=1)), "re-arming"),
    (replace(CONFIG, ecu=EcuConfig(hold_periods=6)), "held pressures"),
    (replace(CONFIG, vehicle=VehicleConfig(action_step=0.15), ecu=EcuConfig(command_step=0.15)), "vehicle: rate"),
    (replace(CONFIG, flow=replace(CONFIG.flow, action_limit=0.09)), "bounds"),
    (replace(CONFIG, flow=replace(CONFIG.flow, action_limit=0.09)), "vehicle: bounds"),
    (replace(CONFIG, vehicle=VehicleConfig(loss_limit=26)), "vehicle: loss limits"),
    (replace(CONFIG, ecu=EcuConfig(hold_periods=4)), "vehicle: doubt"),
    (replace(CONFIG, ecu=EcuConfig(plan_ahead=False)), "vehicle: doubt"),
)
"""Settings that are laxer than what the judges hold the nodes against."""


def test_a_lax_setting_is_found():
    for lax, promise in LAX:
        assert promise in broken_in(World(lax, judged_by=CONFIG), STORIES[promise]), (promise, lax)
    one_more = World(Config(ecu=EcuConfig(loss_limit=26)), judged_by=CONFIG)
    assert broken_in(one_more, HALF_LOST) == {"loss limits"}


def no_gate(flow_m2_per_s, *, enable, **others):
    return GatedCommand(flow_m2_per_s=min(max(flow_m2_per_s, -4.0), 4.0), enable=enable, interventions=Intervention(0))


def status_with(change):
    return EcuState, "status", lambda self, bundle, status=EcuState.status: status(change(self), bundle)


def one_ahead(self, *args, of=PressureReception.of, **kwargs):
    seen = of(self, *args, **kwargs)
    return seen if seen.counter is None else seen._replace(counter=(seen.counter + 1) % 256)


def always_wanted(self, *args, sample=VehicleNode.sample, **kwargs):
    frame = sample(self, *args, **kwargs)
    self._requested = True
    return frame


def without_a_fault(self, *args, after=StepTiming.next):
    return replace(after(self, *args), fault=None)


def held_in_decay(self, mode, memory, of=ecu.Ecu._decide):
    return of(self, OperatingMode.HOLD if mode is OperatingMode.DECAY else mode, memory)


def control_in_fault(mode, period, taken=fail_safe.taken):
    return taken(OperatingMode.CONTROL if mode is OperatingMode.FAULT else mode, period)


TAKEN_AWAY: tuple[tuple[str, *tuple[tuple[Any, str, Any], ...]], ...] = (
    ("clock", (StepTiming, "next", without_a_fault), (ecu, "gate", no_gate)),
    ("bus-off", (ecu, "_bus_fault", lambda before, now: None)),
    ("controller", (controller_memory, "_checked", lambda name, values, shape: np.zeros(shape))),
    ("power-on", (ecu_state, "FailSafe", lambda: FailSafe(mode=OperatingMode.ARMED, enable_request=False))),
    ("shut unless active", (OperatingMode, "drives_jets", property(lambda self: True))),
    ("reasons", status_with(lambda state: replace(state, fail_safe=replace(state.fail_safe, reason=Reason.NONE)))),
    ("counts", status_with(lambda state: replace(state, missed=0))),
    ("frames", (SenderState, "next", lambda self, spec: self)),
    ("exceptions", (controller_memory, "Exception", ZeroDivisionError)),
    ("held pressures", (ecu.Ecu, "_decide", held_in_decay)),
    ("fresh pressures", (PressureReception, "of", one_ahead)),
    ("re-arming", (fail_safe, "taken", control_in_fault)),
    ("vehicle: request", (VehicleNode, "sample", always_wanted)),
    ("vehicle: doubt", (EchoTracker, "age", property(lambda self: 0))),
)
"""Promises, and what is put in place of their safeguards."""


def test_a_safeguard_taken_away_is_found(monkeypatch):
    for promise, *patches in TAKEN_AWAY:
        with monkeypatch.context() as patch:
            for owner, name, value in patches:
                patch.setattr(owner, name, value, raising=False)
            story = OLD if promise == "vehicle: doubt" else STORIES[promise]
            assert promise in broken_in(World(CONFIG), story), promise
    assert {promise for promise, *_ in TAKEN_AWAY} | {promise for _, promise in LAX} == set(PROMISES)


def test_the_same_seed_is_the_same_and_what_is_broken_is_reported_with_its_stretch(monkeypatch):
    third = range(3 * hostile.STRETCH, 3 * hostile.STRETCH + 200)
    one, again, other = (hostile.stretch(third, seed=seed)._replace(rss_kib=0) for seed in (7, 7, 8))
    assert one == again != other
    figures = hostile.summed([one, again])
    assert (figures["steps"], figures["violations"], figures["exceptions"]) == (400, 0, 0)
    assert sum(figures["modes"].values()) <= 400
    assert figures["jets_driven"] == 2 * one.driven > 0
    monkeypatch.setattr(SenderState, "next", lambda self, spec: self)
    figures = hostile.summed([hostile.stretch(range(50), seed=0)])
    # The first step's counter is right.
    assert figures["violations"] >= figures["broken"]["frames"] == 49
    assert figures["first_violations"][0] == "stretch 0 (as they are), period 1: frames"


CLOCK_NS = st.sampled_from(hostile_world.JUMPS_NS) | st.sampled_from(hostile_world.UNEVEN_NS)
ODD: dict[str, st.SearchStrategy[Any]] = {
    **dict.fromkeys(("pressure", "command"), st.sampled_from(hostile_world.FATES)),
    **dict.fromkeys(("valid", "steps"), st.just(False)),
    **dict.fromkeys(("bus_off", "reset_ecu", "reset_vehicle"), st.just(True)),
    "queued_ns": st.sampled_from(hostile_world.QUEUED_NS),
    "deed": st.sampled_from(hostile_world.GOOD + hostile_world.BAD),
    "elapsed_ns": CLOCK_NS | st.integers(-(10**12), 10**14),
}
COMMON: dict[str, st.SearchStrategy[Any]] = {
    **{"request": st.booleans(), "value": st.floats(-0.2, 0.2), "unseen": st.booleans()},
    "chance": st.integers(0, 2**32 - 1),
}
ONE = st.one_of(st.builds(Events, **COMMON), *(st.builds(Events, **COMMON, **{name: ODD[name]}) for name in ODD))
STRETCHES = st.tuples(st.integers(1, 8), ONE)  # some periods each; what is not named is in order
SETTINGS = {"hold_periods": st.integers(0, 2), "decay_periods": st.integers(0, 2), "rearm_frames": st.integers(1, 5)}


@pytest.mark.slow  # a thousand periods and more
@given(st.fixed_dictionaries(SETTINGS), st.booleans(), st.lists(STRETCHES, max_size=20))
@examples(40)
def test_no_story_that_hypothesis_finds_breaks_a_promise(limits, plan_ahead, stretches):
    world = World(Config(ecu=EcuConfig(plan_ahead=plan_ahead, **limits)))
    story = [replace(one, chance=one.chance + k) for periods, one in stretches for k in range(periods)]
    for events in [*CALM, *story]:
        assert world.period(events) == [], world.seen
