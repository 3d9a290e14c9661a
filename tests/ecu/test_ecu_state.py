"""The ECU as a function of state, time and frames: saved at any step, it goes on to the bit."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode, Reason
from contract.controller.interface import ControllerError, ControlStep
from tests.each import each
from tests.ecu.conftest import make_bench, make_bundle
from tests.examples import examples


class Mixing:
    """A controller whose plan depends on every number it is given, and on nothing else."""

    def control_step(self, window, plan, free, weights=None, speed=1.0, limit=None) -> ControlStep:
        weights = np.linspace(-0.01, 0.02, window.size).reshape(window.shape)
        drive = 0.05 * np.sin(np.sum(weights * window) + np.arange(len(plan)))
        shifted = np.append(plan[1:], plan[-1])
        if window[-1, 0] > 3.0:
            raise ControllerError("too much pressure")
        new = np.where(free > 0.5, 0.5 * shifted + drive, shifted)
        return ControlStep(plan=new, forces=np.outer(new, [1.0, -1.0]), terms=np.zeros(8), cost=float(np.sum(new**2)))


# G/g good with and without request, x none, c corrupted, i invalid sensor, R repeated, S a skipped period, P a
# pressure that the controller does not bear. The episode goes through every mode.
EPISODE = "GGxGGcxGGiGSGGRGGxxxxxxggggggGGGGGSGGGPGgggggGGGGGSSSSGGGG"
ALPHABET = "GGGGGGgxciRSP"


def periods_of(bench, events: str) -> list[tuple[int, list[Frame]]]:
    """Time and frames of each period; the bench only makes the frames."""
    rng, latest, periods = np.random.default_rng(5), bench.pressure(), []
    for event in events:
        cp = {"P": (4.0,) * 4, "i": (np.nan,) * 4}.get(event, rng.uniform(-1.0, 1.0, 4))
        frame = latest if event == "R" else bench.pressure(cp, enable=event != "g")
        if event == "c":
            frame = replace(frame, data=frame.data[:-1] + bytes([frame.data[-1] ^ 1]))
        if event == "S":
            bench.now_ns += bench.config.period_ns
        periods.append((bench.now_ns, [] if event == "x" else [frame]))
        latest = frame
        bench.now_ns += bench.config.period_ns
    return periods


def identical(one, other) -> bool:
    forces = [None if trace.forces is None else trace.forces.tobytes() for *_, trace in (one, other)]
    rest = [vars(replace(trace, forces=None)) for *_, trace in (one, other)]
    return (*one[:2], forces[0], rest[0]) == (*other[:2], forces[1], rest[1])


@pytest.mark.slow  # pickles states
@given(events=st.text(ALPHABET, max_size=40), delay=st.integers(0, 2))
@examples(12)
@example(events=EPISODE, delay=0)
@example(events=EPISODE, delay=2)
def test_a_step_is_a_function_of_state_time_and_frames(events, delay):
    """Also of one that was pickled, or copied into another ECU, which goes on with it."""
    bench = make_bench(Mixing(), delay_steps=delay, deadline_misses=2)
    other, third = (make_bench(Mixing(), delay_steps=delay, deadline_misses=2).ecu for _ in range(2))
    modes, reasons = set(), set()
    for period in periods_of(bench, "gGGGGG" + events):
        before = bench.ecu.state
        kept = pickle.dumps(before)
        outcome = after, sent, trace = bench.ecu.next(before, *period)
        assert bench.ecu.state is before
        assert identical(outcome, bench.ecu.next(before, *period))
        assert identical(outcome, other.next(pickle.loads(kept), *period))
        third.restore(copy.deepcopy(before))
        third = pickle.loads(pickle.dumps(third))
        assert third.trace.action == before.memory.under_way.newest
        assert third.step(*period) == bench.ecu.step(*period) == sent
        assert bench.ecu.state == third.state == after
        assert third.status() == bench.ecu.status()
        assert pickle.dumps(before) == kept
        modes.add(trace.mode)
        reasons.add(after.fail_safe.reason)
    assert other.state == make_bench(Mixing(), delay_steps=delay).ecu.state
    if events == EPISODE:
        assert modes == set(Mode)
        assert reasons >= {Reason.INTERNAL, Reason.DEADLINE, Reason.STREAM_LOST, Reason.SENSOR_INVALID}


@each(
    "bundle, settings, named",
    [
        ({"window": 6}, {}, r"= \(6, 4, 5, 0\): this ECU has \(4, 4, 5, 0\)"),
        ({}, {"delay_steps": 1}, r"= \(4, 4, 5, 1\): this ECU has \(4, 4, 5, 0\)"),
    ],
)
def test_a_state_of_another_controller_is_refused(bundle, settings, named):
    state = make_bench(bundle=make_bundle(**bundle), **settings).ecu.state
    with pytest.raises(ValueError, match=named):
        make_bench().ecu.restore(state)
