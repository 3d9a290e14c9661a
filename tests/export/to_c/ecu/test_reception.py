"""A period's frames in C against the Python reception, and times at the ends of 64 bits."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from can_bridge.command_gate import GateLimits
from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.receiver import ReceiverState, StreamState
from can_bridge.secoc.receiver import VerifierState
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Pressure, Reason
from firmware_sim.ecu.other_ecu import is_of_another_ecu
from firmware_sim.ecu.pressure_reception import PressureReception
from tests.examples import examples
from tests.export.to_c.ecu.test_receiver import state_of

MS = 1_000_000
INT64 = st.integers(-(2**63), 2**63 - 1)
LATEST = 2**63 - 1

CONTENT = st.builds(
    Pressure,
    pressure_pa=st.tuples(*[st.floats(-2000, 2000)] * 4),
    valid=st.sampled_from([(True,) * 4] * 4 + [(True, True, False, True), (False,) * 4]),
    enable_request=st.booleans(),
    age_ns=st.integers(0, 80 * MS),
)
PERIOD = st.tuples(
    st.lists(st.tuples(CONTENT, st.sampled_from((1, 1, 1, 0, 2, 9)), st.booleans()), max_size=2),
    st.integers(0, 60 * MS),
)


def reception_of(parts) -> PressureReception:
    return PressureReception(
        message=parts.messages.pressure,
        key=None,
        e2e=parts.config.bus.e2e,
        dynamic_pressure=parts.config.operating_point.dynamic_pressure,
        fresh_age_ns=GateLimits.from_config(parts.config).fresh_age_ns,
    )


def answer(parts, receiver, frames: list[Frame], now_ns: int):
    received = parts.ffi.new("sw_received *")
    parts.lib.sw_reception(received, receiver, parts.frames(frames), len(frames), now_ns)
    return received


def assert_same(received, expected) -> None:
    assert bool(received.usable) == (expected.cp is not None)
    assert bool(received.has_request) == (expected.enable_request is not None)
    assert received.enable_request == bool(expected.enable_request)
    assert Reason(received.unusable_because) is expected.unusable_because
    assert received.counter == (expected.counter or 0)
    assert received.sampled_ns == (expected.sampled_ns or 0)
    # To the bit: the same product and quotient of doubles.
    assert list(received.cp) == ([0.0] * 4 if expected.cp is None else expected.cp.tolist())


def pressure_frame(parts, content: Pressure, counter: int, now_ns: int) -> Frame:
    message = parts.messages.pressure
    profile = profile_of(message.spec)
    counter %= profile.counter_period
    data = profile.protect(message.emit(content), data_id=message.spec.data_id, counter=counter)
    return Frame(frame_id=message.spec.frame_id, data=data, timestamp_ns=now_ns)


GOOD = Pressure(pressure_pa=(1.0, -2.0, 3.5, 700.0), valid=(True,) * 4, enable_request=True, age_ns=MS)


@given(story=st.lists(PERIOD, max_size=25))
@example(story=[([(GOOD, 1, True)], 0)] * 5 + [([(GOOD._replace(enable_request=False), 1, False)], 0)] * 6)
@examples(300)
def test_every_period_is_received_as_in_python(parts, story):
    reception, state = reception_of(parts), ReceiverState()
    receiver = parts.ffi.new("sw_receiver *")
    counter, now_ns = 0, 0
    for sent, waited_ns in story:
        frames = []
        for content, step, sound in sent:
            counter += step
            frame = pressure_frame(parts, content, counter, now_ns)
            frames.append(frame if sound else Frame(frame_id=frame.frame_id, data=bytes(len(frame.data))))
        now_ns += waited_ns
        expected = reception.of(frames, now_ns, verifier=VerifierState(), receiver=state)
        assert_same(answer(parts, receiver, frames, now_ns), expected)
        state = expected.receiver
        assert state_of(parts, receiver) == state
        now_ns += 20 * MS - waited_ns % (20 * MS)


def trusted(parts):
    """A receiver whose stream is valid, and Python's."""
    receiver, state = parts.ffi.new("sw_receiver *"), ReceiverState()
    for counter in range(3):
        frames = [pressure_frame(parts, GOOD, counter, 0)]
        answer(parts, receiver, frames, 0)
        state = reception_of(parts).of(frames, 0, verifier=VerifierState(), receiver=state).receiver
    assert state.stream is StreamState.VALID
    return receiver, state


@given(
    timestamp=st.one_of(st.integers(0, 2**63 - 1), st.integers(0, 90 * MS), st.integers(LATEST - 90 * MS, LATEST)),
    now=st.one_of(INT64, st.integers(-90 * MS, 90 * MS), st.integers(LATEST - 90 * MS, LATEST)),
    age=st.integers(0, 80 * MS),
)
@example(timestamp=0, now=-(2**63), age=0)
@example(timestamp=LATEST, now=-(2**63), age=0)
@example(timestamp=0, now=LATEST, age=80 * MS)
@example(timestamp=0, now=-30 * MS, age=30 * MS)
@examples(500)
def test_any_times_are_judged_as_numbers_without_bounds_are(parts, timestamp, now, age):
    receiver, state = trusted(parts)
    frames = [pressure_frame(parts, GOOD._replace(age_ns=age), 3, timestamp)]
    expected = reception_of(parts).of(frames, now, verifier=VerifierState(), receiver=state)
    assert_same(answer(parts, receiver, frames, now), expected)


@pytest.mark.parametrize("age_ns", [0, 1, 30 * MS])
@pytest.mark.parametrize("late_ns", [-1, 0, 1])
def test_pressures_are_fresh_to_the_nanosecond(parts, age_ns, late_ns):
    """At the oldest age that may be planned on, by what the frame itself says of its age."""
    receiver, _ = trusted(parts)
    frame = pressure_frame(parts, GOOD._replace(age_ns=age_ns), 3, 10**9)
    said = parts.messages.pressure.parse(frame.data)
    assert said is not None
    limit_ns = GateLimits.from_config(parts.config).fresh_age_ns
    received = answer(parts, receiver, [frame], 10**9 - said.age_ns + limit_ns + late_ns)
    assert bool(received.usable) == (late_ns <= 0)
    assert received.unusable_because == (Reason.STALE if late_ns > 0 else Reason.NONE)


@given(timestamp=st.integers(-(2**63), -1), now=INT64)
@example(timestamp=-(2**63), now=-(2**63))
@example(timestamp=-1, now=0)
def test_a_frame_of_a_time_before_0_is_stale(parts, timestamp, now):
    receiver, _ = trusted(parts)
    frames = parts.frames([pressure_frame(parts, GOOD, 3, 0)])
    frames[0].timestamp_ns = timestamp
    received = parts.ffi.new("sw_received *")
    parts.lib.sw_reception(received, receiver, frames, 1, now)
    assert (received.usable, received.unusable_because) == (0, Reason.STALE)
    assert (received.has_request, received.enable_request) == (1, 1)


@given(
    which=st.integers(0, 2),
    length=st.sampled_from((0, 1, 2, 3, 8, 12, 24, 64)),
    sound=st.booleans(),
    extended=st.booleans(),
    offset=st.sampled_from((0, 0, 0, 1)),
)
def test_another_ecu_is_heard_as_in_python(parts, which, length, sound, extended, offset):
    spec = parts.messages.specs[which]
    data = profile_of(spec).protect(bytes(range(spec.length)), data_id=spec.data_id, counter=5)
    data = (data if sound else bytes(len(data))).ljust(64, b"\x55")[:length]
    frames = [
        pressure_frame(parts, GOOD, 0, 0),
        Frame(frame_id=spec.frame_id + offset, data=data, is_extended=extended),
        Frame(frame_id=0x7FF, data=b""),
    ]
    expected = any(is_of_another_ecu(frame, parts.messages, None) for frame in frames)
    assert parts.lib.sw_hears_other_ecu(parts.frames(frames), len(frames)) == expected
    if which > 0 and sound and length >= spec.length and not (extended or offset):
        assert expected


def test_no_frames_are_no_other_ecu(parts):
    assert parts.lib.sw_hears_other_ecu(parts.ffi.NULL, 0) == 0
