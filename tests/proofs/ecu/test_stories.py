"""ECU and vehicle through whatever hypothesis can think of: judged from outside, and shrunk to the shortest story."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from tests.examples import examples
from tests.proofs.ecu.hostile_world import BAD, CALM, FATES, GOOD, JUMPS_NS, QUEUED_NS, UNEVEN_NS, Events, World

ODD: dict[str, st.SearchStrategy[Any]] = {
    **dict.fromkeys(("pressure", "command"), st.sampled_from(FATES)),
    **dict.fromkeys(("valid", "steps"), st.just(False)),
    **dict.fromkeys(("bus_off", "reset_ecu", "reset_vehicle"), st.just(True)),
    "queued_ns": st.sampled_from(QUEUED_NS),
    "deed": st.sampled_from(GOOD + BAD),
    "elapsed_ns": st.sampled_from(JUMPS_NS) | st.sampled_from(UNEVEN_NS) | st.integers(-(10**12), 10**14),
}
COMMON: dict[str, st.SearchStrategy[Any]] = {
    **{"request": st.booleans(), "value": st.floats(-0.2, 0.2), "unseen": st.booleans()},
    "chance": st.integers(0, 2**32 - 1),
}
ONE = st.one_of(st.builds(Events, **COMMON), *(st.builds(Events, **COMMON, **{name: ODD[name]}) for name in ODD))
STRETCHES = st.tuples(st.integers(1, 8), ONE)
"""Some periods each; what is not named is in order."""
SETTINGS = {"hold_periods": st.integers(0, 2), "decay_periods": st.integers(0, 2), "rearm_frames": st.integers(1, 5)}


@pytest.mark.slow  # a thousand periods and more
@given(st.fixed_dictionaries(SETTINGS), st.booleans(), st.lists(STRETCHES, max_size=20))
@examples(40)
def test_no_story_that_hypothesis_finds_breaks_a_promise(limits, plan_ahead, stretches):
    world = World(Config(ecu=EcuConfig(plan_ahead=plan_ahead, **limits)))
    story = [replace(one, chance=one.chance + k) for periods, one in stretches for k in range(periods)]
    for events in [*CALM, *story]:
        assert world.period(events) == [], world.seen
