import copy
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.controller.interface import ControllerError
from ecu.controller_memory import ControllerMemory, DelayLine
from tests.each import each
from tests.ecu.conftest import Answering, RecordingController, answer_of


def memory_of(length: int, *, sensors=1, horizon=4, delay=0) -> ControllerMemory:
    return ControllerMemory.empty(length=length, sensors=sensors, horizon=horizon, delay=delay)


def after(memory: ControllerMemory, cp: list[float], action: float) -> ControllerMemory:
    return replace(memory, under_way=DelayLine((action,))).observed(np.array(cp))


NO_ANSWERS = [
    *(ValueError("x"), MemoryError(), RecursionError(), None, "plan", np.zeros(4)),
    *(answer_of(plan=plan) for plan in (None, [0.0] * 4, np.zeros(()), np.zeros(3), np.zeros(5), np.zeros((4, 2)))),
    *(answer_of(plan=np.zeros(4, dtype=kind)) for kind in (object, "U3", bool, complex, "datetime64[s]")),
    *(answer_of(forces=forces) for forces in (None, np.zeros(4), np.zeros((2, 4)), np.zeros((5, 2)))),
    answer_of(plan=np.array([0.0, None, 0.0, 0.0])),
    answer_of(forces=np.full((4, 2), "x", dtype=object)),
]


@each("answer", NO_ANSWERS)
def test_whatever_else_a_controller_does_is_an_error_of_the_controller(answer):
    memory = after(memory_of(1), [1.0], 0.0)
    with pytest.raises(ControllerError, match="the controller"):
        memory.planned(Answering(answer))


@each("copied", [lambda memory: memory, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))])
def test_no_array_can_be_written_and_equal_means_equal_in_every_part(copied):
    memory = after(after(memory_of(2), [1.0], 0.1), [2.0], 0.2)
    assert copied(memory) == memory != "memory"
    for step in map(copied, [memory_of(2), memory, memory.bridged(1), memory.planned(RecordingController())[0]]):
        for array in (step.window, step.plan):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0
    changes: dict[str, Any] = {"window": memory.window + 1.0, "rows": 1, "gap": 1, "plan": memory.plan + 1.0}
    for name, value in {**changes, "under_way": DelayLine((0.3,))}.items():
        assert replace(memory, **{name: value}) != memory, name


@given(
    actions=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=12),
    length=st.integers(1, 6),
    before=st.integers(0, 4),
    after=st.integers(0, 4),
)
def test_another_delay_is_as_if_it_had_always_been_that(actions, length, before, after):
    """All of it where the delay became shorter; where it became longer, but for what is from before the window."""
    memories = [memory_of(length, delay=delay) for delay in (before, after)]
    for k, action in enumerate(actions):
        memories = [memory.observed(np.array([float(k)])).commanded(action) for memory in memories]
    changed, always = memories[0].with_delay(after), memories[1]
    assert (changed.sizes, changed.rows) == (always.sizes, always.rows)
    known = slice(max(0, after - before), None)
    np.testing.assert_array_equal(changed.window[known], always.window[known])
    np.testing.assert_array_equal(changed.window[:, :-1], always.window[:, :-1])
    if after <= before + length:
        assert changed.under_way == always.under_way


@each(
    "before, after, plan",
    [
        (1, 0, [0.2, 0.3, 0.4, 0.4]),
        (0, 2, [0.1, 0.1, 0.1, 0.2]),
        (1, 2, [0.1, 0.1, 0.2, 0.3]),
        (2, 2, [0.1, 0.2, 0.3, 0.4]),
    ],
)
def test_with_another_delay_the_next_planned_action_is_the_same(before, after, plan):
    memory = replace(memory_of(1, delay=before), plan=np.array([0.1, 0.2, 0.3, 0.4]))
    changed = memory.with_delay(after)
    np.testing.assert_array_equal(changed.plan, plan)
    if max(before, after) + 1 < len(plan):
        # What is sent next is settled periods into the shifted plan.
        assert changed.plan[after + 1] == memory.plan[before + 1]


def test_where_no_row_has_come_another_delay_writes_none():
    memory = memory_of(3, delay=2).commanded(0.1).commanded(0.2).commanded(0.3)
    changed = memory.observed(np.array([5.0])).commanded(0.4).with_delay(0)
    np.testing.assert_array_equal(changed.window, [[0.0, 0.0], [0.0, 0.0], [5.0, 0.3]])
    assert changed.under_way.values == (0.4,)


def test_at_another_speed_a_longer_delay_finds_the_sent_actions():
    memory = ControllerMemory.empty(length=4, sensors=1, horizon=6, delay=0, past=6)
    for action in (0.01, 0.02, 0.03):
        memory = memory.observed(np.zeros(1), 0.7).commanded(action)
    assert memory.with_delay(2).under_way.values == pytest.approx((0.01, 0.02, 0.03))
