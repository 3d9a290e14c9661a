"""The ECU as a function of state, time and frames: saved at any step, it goes on to the bit."""

import copy
import pickle
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode, Reason
from contract.controller.interface import ControllerError, ControlStep
from firmware_sim.ecu.ecu import Ecu, StepOutcome
from firmware_sim.ecu.ecu_state import EcuState
from tests.each import each


class Mixing:
    """A controller whose plan depends on every number it is given, and on nothing else."""

    def control_step(self, window, plan, free, weights=None) -> ControlStep:
        weights = np.linspace(-0.01, 0.02, window.size).reshape(window.shape)
        drive = 0.05 * np.sin(np.sum(weights * window) + np.arange(len(plan)))
        shifted = np.append(plan[1:], plan[-1])
        if window[-1, 0] > 3.0:
            raise ControllerError("too much pressure")
        new = np.where(free > 0.5, 0.5 * shifted + drive, shifted)
        forces = np.outer(new, [1.0, -1.0])
        return ControlStep(plan=new, forces=forces, terms=np.zeros(7), cost=float(np.sum(new**2)))


class Period(NamedTuple):
    now_ns: int
    frames: list[Frame]


# G/g good with and without request, x none, c corrupted, i invalid sensor, R repeated, S a skipped period, P a
# pressure that the controller does not bear.
EPISODE = "gGGGGGGGxGGcxGGiGSGGRGGxxxxxxggggggGGGGGSGGGPGgggggGGGGGSSSSGGGG"
ALPHABET = "GGGGGGgxciRSP"


def periods_of(bench, events: str) -> list[Period]:
    """What arrives in each period; the bench only makes the frames."""
    rng, latest, periods = np.random.default_rng(5), bench.pressure(), []
    for event in events:
        cp = (4.0,) * 4 if event == "P" else tuple(rng.uniform(-1.0, 1.0, 4))
        frame = latest if event == "R" else bench.pressure(cp, enable=event != "g", valid=(event != "i",) * 4)
        if event == "c":
            frame = replace(frame, data=frame.data[:-1] + bytes([frame.data[-1] ^ 1]))
        if event == "S":
            bench.now_ns += bench.config.period_ns
        periods.append(Period(bench.now_ns, [] if event == "x" else [frame]))
        latest = frame
        bench.now_ns += bench.config.period_ns
    return periods


@dataclass(frozen=True)
class Step:
    state_before: EcuState
    period: Period
    sent: list[Frame]
    state_after: EcuState


def recorded(ecu: Ecu, periods: list[Period]) -> list[Step]:
    steps = []
    for period in periods:
        before = ecu.state
        sent = ecu.step(*period)
        steps.append(Step(before, period, sent, ecu.state))
    return steps


def identical(one: StepOutcome, other: StepOutcome) -> bool:
    """In state, frames and trace, to the bit."""
    forces = [None if outcome.trace.forces is None else outcome.trace.forces.tobytes() for outcome in (one, other)]
    rest = [replace(outcome.trace, forces=None) for outcome in (one, other)]
    return (one.state, one.frames, forces[0], vars(rest[0])) == (other.state, other.frames, forces[1], vars(rest[1]))


@each("delay", [0, 2])
@each("saved", [copy.deepcopy, lambda state: pickle.loads(pickle.dumps(state))])
def test_restored_at_any_step_it_sends_the_rest_of_the_episode(bench_of, saved, delay):
    bench = bench_of(Mixing(), delay_steps=delay, deadline_misses=2)
    steps = recorded(bench.ecu, periods_of(bench, EPISODE))
    modes = {step.state_after.fail_safe.mode.on_wire for step in steps}
    reasons = {step.state_after.fail_safe.reason for step in steps}
    assert modes == set(Mode)
    assert reasons >= {Reason.INTERNAL, Reason.DEADLINE, Reason.STREAM_LOST, Reason.SENSOR_INVALID}
    for start in range(0, len(steps), 3):
        other = bench_of(Mixing(), delay_steps=delay, deadline_misses=2).ecu
        other.restore(saved(steps[start].state_before))
        assert other.trace.action == steps[start].state_before.memory.under_way.newest
        for step in steps[start:]:
            assert other.step(*step.period) == step.sent
        assert other.state == steps[-1].state_after
        assert (other.status(), other.frames_rejected) == (bench.ecu.status(), bench.ecu.frames_rejected)


@pytest.mark.slow  # pickles states
@given(events=st.text(ALPHABET, max_size=40), delay=st.integers(0, 2))
def test_a_step_is_a_function_of_state_time_and_frames(bench_of, events, delay):
    bench = bench_of(Mixing(), delay_steps=delay)
    other = bench_of(Mixing(), delay_steps=delay).ecu
    for period in periods_of(bench, "gGGGGG" + events):
        before = bench.ecu.state
        kept = pickle.dumps(before)
        outcome = bench.ecu.next(before, *period)
        assert bench.ecu.state is before
        assert identical(outcome, bench.ecu.next(before, *period))
        assert identical(outcome, other.next(pickle.loads(kept), *period))
        assert pickle.dumps(before) == kept
        assert bench.ecu.step(*period) == outcome.frames
        assert bench.ecu.state == outcome.state
    assert other.state == bench_of(Mixing(), delay_steps=delay).ecu.state


def test_a_hand_over_after_a_long_silence_is_one_of_any_longer_silence(bench_of):
    """Counters apart, nothing is left of what was before."""
    after = []
    for periods in (8, 50_000):
        bench = bench_of(Mixing(), delay_steps=2)
        bench.good(8)
        bench.now_ns += periods * bench.config.period_ns
        bench.good(1)
        after.append(bench.ecu.state)
    assert after[0].memory == after[1].memory
    assert after[1].overruns - after[0].overruns == 50_000 - 8


@each(
    "bundle, settings, named",
    [
        ({"window": 6}, {}, r"= \(6, 4, 5, 0\): this ECU has \(4, 4, 5, 0\)"),
        ({}, {"delay_steps": 1}, r"= \(4, 4, 5, 1\): this ECU has \(4, 4, 5, 0\)"),
    ],
)
def test_a_state_of_another_controller_is_refused(bench_of, bundle_of, bundle, settings, named):
    state = bench_of(bundle=bundle_of(**bundle), **settings).ecu.state
    with pytest.raises(ValueError, match=named):
        bench_of().ecu.restore(state)
