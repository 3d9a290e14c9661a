"""ECU and vehicle through whatever hypothesis can think of: judged from outside, and shrunk to the shortest story."""

from itertools import product

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule, run_state_machine_as_test

from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from tests.proofs.ecu.hostile_controller import BAD, GOOD
from tests.proofs.ecu.hostile_world import FATES, JUMPS_NS, QUEUED_NS, UNEVEN_NS, Events, World

SEEDS = st.integers(0, 2**32 - 1)
VALUES = st.floats(-0.2, 0.2)


class HostilePeriods(RuleBasedStateMachine):
    """Each rule is a period, or a few; what is not named in it is in order."""

    def __init__(self) -> None:
        super().__init__()
        self.request = False
        self.world = World(Config())

    @initialize(plan_ahead=st.booleans(), hold=st.integers(0, 2), decay=st.integers(0, 2), rearm=st.integers(1, 5))
    def begin(self, plan_ahead, hold, decay, rearm) -> None:
        ecu = EcuConfig(plan_ahead=plan_ahead, hold_periods=hold, decay_periods=decay, rearm_frames=rearm)
        self.world = World(Config(ecu=ecu))
        self.period(request=False)

    def period(self, **events) -> None:
        self.request = events.pop("request", self.request)
        assert self.world.period(Events(request=self.request, **events)) == [], self.world.seen

    @rule(number=st.integers(1, 8), value=VALUES, deed=st.sampled_from(GOOD))
    def in_order(self, number, value, deed) -> None:
        for _ in range(number):
            self.period(value=value, deed=deed)

    @rule()
    def request_changes(self) -> None:
        self.period(request=not self.request)

    @precondition(lambda self: not self.request)
    @rule(value=VALUES)
    def into_control(self, value) -> None:
        for request in [False] * 5 + [True] * 6:
            self.period(request=request, value=value)

    @rule(fate=st.sampled_from(FATES), number=st.integers(1, 6), chance=SEEDS, value=VALUES)
    def pressures_on_a_bad_bus(self, fate, number, chance, value) -> None:
        for k in range(number):
            self.period(pressure=fate, chance=chance + k, value=value)

    @rule(fate=st.sampled_from(FATES), number=st.integers(1, 6), chance=SEEDS, value=VALUES)
    def commands_on_a_bad_bus(self, fate, number, chance, value) -> None:
        for k in range(number):
            self.period(command=fate, chance=chance + k, value=-value)

    @rule(queued_ns=st.sampled_from(QUEUED_NS), valid=st.booleans(), request=st.booleans(), chance=SEEDS)
    def pressures_that_are_not_usable(self, queued_ns, valid, request, chance) -> None:
        self.period(queued_ns=queued_ns, valid=valid, request=request, chance=chance)

    @rule(deed=st.sampled_from(BAD), value=VALUES)
    def controller_fails(self, deed, value) -> None:
        self.period(deed=deed, value=value)

    @rule(elapsed_ns=st.one_of(st.sampled_from(JUMPS_NS), st.sampled_from(UNEVEN_NS), st.integers(-(10**12), 10**14)))
    def clock_is_wrong(self, elapsed_ns) -> None:
        self.period(elapsed_ns=elapsed_ns)

    @rule(number=st.integers(1, 5))
    def ecu_does_not_step(self, number) -> None:
        for _ in range(number):
            self.period(steps=False)
        self.period(elapsed_ns=20_000_000 * (number + 1))

    @rule(unseen=st.booleans())
    def bus_off(self, unseen) -> None:
        self.period(bus_off=True, unseen=unseen)

    @rule(ecu=st.booleans())
    def reset(self, ecu) -> None:
        self.period(reset_ecu=ecu, reset_vehicle=not ecu)


@pytest.mark.slow  # a thousand periods and more
def test_no_story_that_hypothesis_finds_breaks_a_promise():
    run_state_machine_as_test(HostilePeriods, settings=settings(max_examples=25, stateful_step_count=20, deadline=None))


UNUSABLE = {Reason.STREAM_LOST, Reason.SENSOR_INVALID, Reason.STALE}
EVERYTHING = {
    *product((Mode.OFF, Mode.WARMUP, Mode.CONTROL), (Reason.NONE,)),
    (Mode.OFF, Reason.NOT_ARMED),
    *product((Mode.HOLD, Mode.DECAY, Mode.FAULT), UNUSABLE),
    *((Mode.FAULT, Reason[name]) for name in ("STREAM_INVALID", "DEADLINE", "BUS_OFF", "INTERNAL", "CLOCK")),
}
"""What the ECU can report where the wire is not authenticated and no sensor is judged by its values."""
WAYS = [
    [Events(pressure="lost")] * 4,
    [Events(pressure="flipped")] * 3,
    [Events(valid=False)] * 4,
    [Events(queued_ns=35_000_000)] * 4,
    [Events(elapsed_ns=10**9)],
    [Events(elapsed_ns=0)],
    [Events(bus_off=True)],
    [Events(deed="raise")],
    [Events(reset_ecu=True)] + [Events()] * 3,
]


def test_the_world_leads_everywhere():
    """Or a campaign by chance would have shown nothing."""
    reached = set()
    for way in WAYS:
        world = World(Config())
        for events in [*(Events(request=k > 0) for k in range(10)), *way]:
            assert world.period(events) == [], world.seen
            reached.add(world.ecu.status()[:2])
    assert reached >= EVERYTHING, EVERYTHING - reached
