"""The controller that says when it planned."""

from itertools import count

import numpy as np
import pytest

from contract.controller.interface import ControllerError, ControlStep
from firmware_sim.ecu.real_time.timed_controller import TimedController


class Asked:
    def __init__(self) -> None:
        self.with_what: list[tuple] = []

    def control_step(self, window, plan, free, weights=None) -> ControlStep:
        self.with_what.append((window, plan, free, weights))
        return ControlStep(plan=plan, forces=np.zeros((1, 2)), terms=np.zeros(7), cost=0.0)


class Failing:
    def control_step(self, window, plan, free, weights=None) -> ControlStep:
        raise ControllerError("none")


def test_it_passes_everything_on_and_notes_before_and_after():
    ticks, asked = count(10), Asked()
    timed = TimedController(asked, lambda: next(ticks))
    assert (timed.times.began_ns, timed.times.ended_ns) == (0, 0)
    given = tuple(np.full(1, value) for value in range(4))
    answer = timed.control_step(*given)
    assert answer.plan is given[1]
    assert all(a is b for a, b in zip(asked.with_what[0], given, strict=True))
    assert (timed.times.began_ns, timed.times.ended_ns) == (10, 11)
    timed.times.forget()
    assert (timed.times.began_ns, timed.times.ended_ns) == (0, 0)


def test_a_failure_has_an_end_too():
    ticks = count(1)
    timed = TimedController(Failing(), lambda: next(ticks))
    with pytest.raises(ControllerError):
        timed.control_step(*(np.zeros(1),) * 3)
    assert (timed.times.began_ns, timed.times.ended_ns) == (1, 2)
