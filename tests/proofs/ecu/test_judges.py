"""The judges of the hostile bus find each defect that is planted, and none where there is none."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from can_bridge.command_gate import GatedCommand, Intervention
from can_bridge.e2e.sender import SenderState
from can_bridge.wire.messages import Reason
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig, VehicleConfig
from firmware_sim.bench.echo import EchoTracker
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.ecu import controller_memory, ecu, ecu_state, state_machine
from firmware_sim.ecu.ecu_state import EcuState
from firmware_sim.ecu.pressure_reception import PressureReception
from firmware_sim.ecu.state_machine import FailSafe, OperatingMode
from firmware_sim.ecu.timing import Timing
from tests.each import each
from tests.proofs.ecu import hostile
from tests.proofs.ecu.hostile_world import Events, RandomEvents, World
from tests.proofs.ecu.promises import PROMISES

CONFIG = Config()


def broken_first(world: World, seed: int, periods: int, hostility: float = 0.1) -> set[str]:
    """What was broken in the first period in which anything was."""
    events = RandomEvents(seed, hostility)
    for _ in range(periods):
        if found := world.period(events.next(world.now_ns)):
            return set(found)
    return set()


CALM = [Events(request=k > 0) for k in range(10)]
"""Into control: the request rises with the second frame."""
SWINGS = [Events(value=value) for value in (0.15, -0.15) * 3]
LOST = [Events(pressure="lost")] * 5
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


@each("story", STORIES)
def test_no_story_breaks_anything_as_it_is(story):
    for settings in hostile.SETTINGS.values():
        assert broken_in(World(Config(ecu=settings)), STORIES[story]) == set()


@pytest.mark.slow  # a run of every judge
@each("settings", hostile.SETTINGS)
@each("hostility", [0.0, 0.03, 0.3])
def test_nothing_is_broken_as_it_is(settings, hostility):
    world = World(Config(ecu=hostile.SETTINGS[settings]))
    assert broken_first(world, 1, 300, hostility) == set()


class Lax(NamedTuple):
    """A setting that is laxer than what the judges hold the nodes against."""

    config: Config
    promise: str


LAX = [
    Lax(replace(CONFIG, ecu=EcuConfig(command_step=0.15)), "rate"),
    Lax(replace(CONFIG, ecu=EcuConfig(pressure_age=4.0)), "fresh pressures"),
    Lax(replace(CONFIG, ecu=EcuConfig(decay_periods=4)), "loss limits"),
    Lax(replace(CONFIG, ecu=EcuConfig(rearm_frames=1)), "re-arming"),
    Lax(replace(CONFIG, ecu=EcuConfig(hold_periods=6)), "held pressures"),
    Lax(replace(CONFIG, vehicle=VehicleConfig(action_step=0.15), ecu=EcuConfig(command_step=0.15)), "vehicle: rate"),
    Lax(replace(CONFIG, flow=replace(CONFIG.flow, action_limit=0.09)), "bounds"),
    Lax(replace(CONFIG, flow=replace(CONFIG.flow, action_limit=0.09)), "vehicle: bounds"),
    Lax(replace(CONFIG, vehicle=VehicleConfig(loss_limit=26)), "vehicle: loss limits"),
    Lax(replace(CONFIG, ecu=EcuConfig(hold_periods=4)), "vehicle: doubt"),
    Lax(replace(CONFIG, ecu=EcuConfig(plan_ahead=False)), "vehicle: doubt"),
]


@each("lax", LAX)
def test_a_lax_setting_is_found(lax):
    assert lax.promise in broken_in(World(lax.config, judged_by=CONFIG), STORIES[lax.promise])


def test_one_loss_more_than_the_limit_is_found():
    """In a pattern, so that none is lost in a row."""
    world = World(Config(ecu=EcuConfig(loss_limit=26)), judged_by=CONFIG)
    found = [world.period(Events(request=k > 0, pressure="lost" if k > 10 and k % 2 else "pass")) for k in range(80)]
    assert {name for broken in found for name in broken} == {"loss limits"}
    assert not any(
        World(CONFIG).period(Events(request=k > 0, pressure="lost" if k > 10 and k % 2 else "pass")) for k in range(80)
    )


def no_gate(flow_m2_per_s, *, enable, **others):
    return GatedCommand(flow_m2_per_s=min(max(flow_m2_per_s, -4.0), 4.0), enable=enable, interventions=Intervention(0))


def plant(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Take one safeguard away."""
    if name == "clock":
        after = Timing.next
        monkeypatch.setattr(Timing, "next", lambda self, *args: replace(after(self, *args), fault=None))
        monkeypatch.setattr(ecu, "gate", no_gate)
    elif name == "bus-off":
        monkeypatch.setattr(ecu, "_bus_fault", lambda before, now: None)
    elif name == "controller":
        monkeypatch.setattr(
            controller_memory, "_checked", lambda name, values, shape: np.zeros(shape, dtype=np.float64)
        )
    elif name == "power-on":
        monkeypatch.setattr(ecu_state, "FailSafe", lambda: FailSafe(mode=OperatingMode.ARMED, enable_request=False))
    elif name == "shut unless active":
        monkeypatch.setattr(OperatingMode, "drives_jets", property(lambda self: True))
    elif name == "reasons":
        monkeypatch.setattr(
            EcuState,
            "status",
            lambda self, bundle, status=EcuState.status: status(
                replace(self, fail_safe=replace(self.fail_safe, reason=Reason.NONE)), bundle
            ),
        )
    elif name == "counts":
        monkeypatch.setattr(
            EcuState, "status", lambda self, bundle, status=EcuState.status: status(replace(self, missed=0), bundle)
        )
    elif name == "frames":
        monkeypatch.setattr(SenderState, "next", lambda self, spec: self)
    elif name == "exceptions":
        monkeypatch.setattr(controller_memory, "Exception", ZeroDivisionError, raising=False)
    elif name == "decay":
        decide = ecu.Ecu._decide
        monkeypatch.setattr(
            ecu.Ecu,
            "_decide",
            lambda self, mode, memory: decide(
                self, OperatingMode.HOLD if mode is OperatingMode.DECAY else mode, memory
            ),
        )
    elif name == "echo":
        of = PressureReception.of

        def one_ahead(self, *args, **kwargs):
            found = of(self, *args, **kwargs)
            return found if found.counter is None else found._replace(counter=(found.counter + 1) % 256)

        monkeypatch.setattr(PressureReception, "of", one_ahead)
    elif name == "re-arming":
        monkeypatch.setattr(
            state_machine,
            "taken",
            lambda mode, period, taken=state_machine.taken: taken(
                OperatingMode.ACTIVE if mode is OperatingMode.FAULT else mode, period
            ),
        )
    elif name == "vehicle: request":
        sample = VehicleNode.sample

        def always_wanted(self, *args, **kwargs):
            frame = sample(self, *args, **kwargs)
            self._requested = True
            return frame

        monkeypatch.setattr(VehicleNode, "sample", always_wanted)
    elif name == "vehicle: age":
        monkeypatch.setattr(EchoTracker, "age", property(lambda self: 0))


@pytest.mark.parametrize(
    ("defect", "promise"),
    [
        *((name, name) for name in ("clock", "bus-off", "controller", "power-on", "shut unless active", "reasons")),
        *((name, name) for name in ("counts", "frames", "exceptions", "re-arming", "vehicle: request")),
        ("decay", "held pressures"),
        ("echo", "fresh pressures"),
        ("vehicle: age", "vehicle: doubt"),
    ],
)
def test_a_safeguard_taken_away_is_found(defect, promise, monkeypatch):
    plant(defect, monkeypatch)
    story = STORIES[promise]
    if defect == "vehicle: age":
        # Commands come three periods late, and then rest on pressures of three periods before them.
        story = [Events(command="late3")] * 12 + [Events(command="late3", pressure="lost")] * 3
        story += [Events(command="late3")] * 5
    assert promise in broken_in(World(CONFIG), story)


def test_every_promise_has_a_planted_defect():
    marks = test_a_safeguard_taken_away_is_found.pytestmark[0].args[1]
    planted = {promise for _, promise in marks} | {lax.promise for lax in LAX}
    assert planted == set(PROMISES)


def test_the_same_seed_is_the_same_in_one_process_and_the_figures_add_up():
    one, again = (hostile.stretch(3, seed=7, periods=200) for _ in range(2))
    assert replace(one, rss_kib=0) == replace(again, rss_kib=0)
    assert replace(one, rss_kib=0) != replace(hostile.stretch(3, seed=8, periods=200), rss_kib=0)
    figures = hostile.summed([one, again])
    assert (figures["steps"], figures["violations"], figures["exceptions"]) == (400, 0, 0)
    assert sum(figures["modes"].values()) <= 400
    assert figures["jets_driven"] == 2 * one.driven > 0


def test_what_is_broken_is_told_with_its_stretch(monkeypatch):
    plant("frames", monkeypatch)
    figures = hostile.summed([hostile.stretch(0, seed=0, periods=50)])
    # The first step's counter is right.
    assert figures["violations"] >= figures["broken"]["frames"] == 49
    assert figures["first_violations"][0] == "stretch 0 (as they are), period 1: frames"


@pytest.mark.proofs
def test_a_million_periods_break_nothing():
    figures = hostile.summed(list(hostile.stretches(1_000_000, seed=0, processes=2)))
    assert figures["violations"] == 0, figures["first_violations"]
