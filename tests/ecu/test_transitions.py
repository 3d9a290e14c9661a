"""Every row of the table is driven by inputs, from each state that it names, and within the periods that it states."""

from dataclasses import replace
from functools import cache
from itertools import product
from unittest.mock import patch

from can_bridge.wire.messages import Reason
from contract.config.vehicle import EcuConfig
from ecu.fail_safe import ALWAYS, TRANSITIONS, FailSafe, OperatingMode, PeriodInputs, Transition, taken
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
        usable=usable, enable_request=asks, unusable_because=because, window_full=full, fault=fault, updating=updating
    )
    for (usable, asks), because, full, (fault, updating) in product(
        [(True, True), (True, False), (False, None), (False, True), (False, False)],
        [Reason.STREAM_LOST, Reason.STREAM_INVALID],
        [True, False],
        [(None, False), (Reason.CLOCK, False), (Reason.CLOCK, True), (None, True)],
    )
    if not (usable and because is Reason.STREAM_INVALID)
]
GOOD, LOW, LOST = (
    PeriodInputs(usable=usable, enable_request=request, unusable_because=Reason.STREAM_LOST, window_full=True)
    for usable, request in ((True, True), (True, False), (False, None))
)


@cache
def happened() -> dict[Transition, list[tuple[FailSafe, FailSafe]]]:
    """All that can happen from power-on on, as the states before and after each row. Long counts are cut off."""
    found: dict[Transition, list[tuple[FailSafe, FailSafe]]] = {}
    rows = list[Transition]()

    def watched(mode, period):
        rows.append(taken(mode, period))
        return rows[-1]

    with patch("ecu.fail_safe.taken", watched):
        for config in (SHORT_HOLD, LONG_HOLD, *OTHERS):
            new, seen = [FailSafe()], set()
            while new:
                before = new.pop()
                for inputs in INPUTS:
                    after = before.next(inputs, config)
                    found.setdefault(rows[-1], []).append((before, after))
                    key = replace(after, misses=min(after.misses, 7), good=min(after.good, 3), reason=Reason.NONE)
                    if key not in seen:
                        seen.add(key)
                        new.append(after)
    return found


def test_every_row_is_reached_from_each_of_its_states_and_leads_where_it_says():
    """And at once, where it states no count: the period before was in order, or there was none with pressures."""
    for row in TRANSITIONS:
        mine = happened()[row]
        assert {before.mode for before, _ in mine} == row.start, row
        assert {after.mode for _, after in mine} == {row.to}, row
        first = [before for before, _ in mine if before.lost == 0]
        at_once = any(before.misses == 0 or before.mode is OperatingMode.INIT for before in first)
        assert at_once or row.within != "1", row
    for mode in OperatingMode:
        assert [row.when for row in TRANSITIONS if mode in row.start][-1] is ALWAYS, mode


STATED = {
    # Pressures are lost from now on; or, with a fault latched, come in order, and the request falls and rises.
    "hold_periods + 1": (OperatingMode.DECAY, SHORT_HOLD, [LOST] * 9),
    "hold_periods + decay_periods + 1": (OperatingMode.FAULT, SHORT_HOLD, [LOST] * 9),
    "loss_limit": (OperatingMode.FAULT, LONG_HOLD, [LOST] * 9),
    "rearm_frames": (OperatingMode.CONTROL, SHORT_HOLD, [LOW, LOW, GOOD]),
}
"""By formula: the state that is led to, with which settings, and what comes."""


@each("formula", sorted({row.within for row in TRANSITIONS} - {"1"}))
def test_a_row_with_a_count_reacts_in_exactly_the_periods_that_it_states(formula):
    mode, config, events = STATED[formula]
    state = FailSafe(mode=OperatingMode.CONTROL, good=9)
    if formula == "rearm_frames":
        for _ in range(4):
            state = state.next(LOST, config)
        assert state.mode is OperatingMode.FAULT
    modes = []
    for inputs in events:
        state = state.next(inputs, config)
        modes.append(state.mode)
    assert modes.index(mode) + 1 == eval(formula, {}, vars(config))
