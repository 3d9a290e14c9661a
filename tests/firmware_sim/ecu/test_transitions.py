"""Every row of the table is driven by inputs, from each state that it names, and within the periods that it states."""

from dataclasses import replace
from itertools import product
from typing import NamedTuple

from can_bridge.wire.messages import Reason
from contract.config.vehicle import EcuConfig
from firmware_sim.ecu import state_machine
from firmware_sim.ecu.state_machine import ALWAYS, TRANSITIONS, FailSafe, OperatingMode, PeriodInputs, Transition
from tests.each import each

SHORT_HOLD = EcuConfig(hold_periods=1, decay_periods=1, rearm_frames=3, loss_window=4, loss_limit=4)
LONG_HOLD = EcuConfig(hold_periods=3, decay_periods=3, rearm_frames=3, loss_window=4, loss_limit=3)
"""One in which misses in a row latch first, and one in which it is their number."""
OTHERS = [
    EcuConfig(hold_periods=hold, decay_periods=decay, rearm_frames=1, loss_window=4, loss_limit=limit)
    for hold, decay, limit in ((0, 0, 4), (0, 2, 4), (1, 0, 4), (3, 3, 1))
]
"""Without hold, without decay, without either, and with the first loss one too many."""

INPUTS = [
    PeriodInputs(
        usable=usable,
        enable_request=request,
        unusable_because=because,
        window_full=full,
        fault=fault,
        updating=updating,
    )
    for (usable, request), because, full, fault, updating in product(
        [(True, True), (True, False), (False, None), (False, True), (False, False)],
        [Reason.STREAM_LOST, Reason.STREAM_INVALID],
        [True, False],
        [None, Reason.CLOCK],
        [False, True],
    )
    if not (usable and because is Reason.STREAM_INVALID)
]
GOOD, LOW, LOST = (
    PeriodInputs(usable=usable, enable_request=request, unusable_because=Reason.STREAM_LOST, window_full=True)
    for usable, request in ((True, True), (True, False), (False, None))
)


class Step(NamedTuple):
    """One period of all that can happen."""

    config: EcuConfig
    before: FailSafe
    inputs: PeriodInputs
    row: Transition
    after: FailSafe


def reached(config: EcuConfig) -> list[Step]:
    """All that can happen from power-on on. Long counts are cut off."""
    taken, found = [], []
    original = state_machine.taken

    def watched(mode, period):
        taken.append(original(mode, period))
        return taken[-1]

    state_machine.taken = watched
    try:
        new, seen = [FailSafe()], set()
        while new:
            before = new.pop()
            for inputs in INPUTS:
                after = before.next(inputs, config)
                found.append(Step(config, before, inputs, taken[-1], after))
                key = replace(after, misses=min(after.misses, 7), good=min(after.good, 3), reason=Reason.NONE)
                if key not in seen:
                    seen.add(key)
                    new.append(after)
    finally:
        state_machine.taken = original
    return found


HAPPENED = [step for config in (SHORT_HOLD, LONG_HOLD, *OTHERS) for step in reached(config)]


@each("row", TRANSITIONS)
def test_every_row_is_reached_from_each_of_its_states_and_leads_where_it_says(row):
    mine = [step for step in HAPPENED if step.row is row]
    assert {step.before.mode for step in mine} == row.start
    assert {step.after.mode for step in mine} == {row.to}


def test_the_first_row_that_holds_is_the_one_that_is_taken():
    """The order of the table, looked through once more without the index that the code uses."""
    for config, before, inputs, row, after in HAPPENED:
        request = before.enable_request if inputs.enable_request is None else inputs.enable_request
        rises = request and not before.enable_request
        period = state_machine.Period(
            inputs, request, rises, after.misses, after.good, after.lost.bit_count(), config, before.reason
        )
        assert row is next(item for item in TRANSITIONS if before.mode in item.start and item.when.holds(period))


def test_no_state_is_left_without_a_row_and_none_is_out_of_reach():
    for mode in OperatingMode:
        assert [row.when for row in TRANSITIONS if mode in row.start][-1] is ALWAYS
    assert {step.before.mode for step in HAPPENED} == set(OperatingMode)


STATED = {
    # Pressures are lost from now on; or, with a fault latched, come in order, and the request falls and rises.
    "hold_periods + 1": (OperatingMode.DECAY, SHORT_HOLD, "x" * 9),
    "hold_periods + decay_periods + 1": (OperatingMode.FAULT, SHORT_HOLD, "x" * 9),
    "loss_limit": (OperatingMode.FAULT, LONG_HOLD, "x" * 9),
    "rearm_frames": (OperatingMode.ACTIVE, SHORT_HOLD, "gggG"[-3:]),
}
"""By formula: the state that is led to, with which settings, and what comes."""


def periods_until(mode: OperatingMode, state: FailSafe, config: EcuConfig, events: str) -> int:
    for number, event in enumerate(events, start=1):
        state = state.next({"x": LOST, "g": LOW, "G": GOOD}[event], config)
        if state.mode is mode:
            return number
    raise AssertionError(f"{mode} is not reached")


@each("formula", sorted({row.within for row in TRANSITIONS} - {"1"}))
def test_a_row_with_a_count_reacts_in_exactly_the_periods_that_it_states(formula):
    mode, config, events = STATED[formula]
    expected = eval(formula, {}, vars(config))
    start = FailSafe(mode=OperatingMode.ACTIVE, good=9)
    if formula == "rearm_frames":
        for _ in range(4):
            start = start.next(LOST, config)
        assert start.mode is OperatingMode.FAULT
    assert periods_until(mode, start, config, events) == expected


@each("row", [row for row in TRANSITIONS if row.within == "1"])
def test_every_other_row_needs_no_more_than_the_period_that_has_its_cause(row):
    """Nothing has been counted before it: the period before was in order, or there was none with pressures."""
    mine = [step for step in HAPPENED if step.row is row and step.before.lost == 0]
    assert any(step.before.misses == 0 or step.before.mode is OperatingMode.INIT for step in mine)
