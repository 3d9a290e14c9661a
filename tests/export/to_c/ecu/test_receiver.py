"""The receiver in C against the Python one over whole streams, and on frames that no bus can carry."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.receiver import GOOD, Check, ReceiverState, StreamState, receive
from can_bridge.wire.frame import FD_LENGTHS, Frame
from tests.examples import examples

STREAMS = (StreamState.NODATA, StreamState.INIT, StreamState.VALID, StreamState.INVALID)

KINDS = ("good", "wrong crc", "other length", "other id", "29 bits", "other data id")
FRAME = st.tuples(
    st.sampled_from(("good", "good", "good", *KINDS)),
    st.sampled_from((0, 1, 1, 1, 2, 4, 5, 100)),
)
PERIODS = st.lists(st.lists(FRAME, max_size=3), max_size=40)


def stream_of(parts, story) -> list[list[Frame]]:
    """Periods of frames; each frame is a kind and by how much its counter goes on."""
    spec = parts.messages.pressure.spec
    periods: list[list[Frame]] = []
    profile, counter = profile_of(spec), 0
    for period in story:
        frames = []
        for kind, step in period:
            counter = (counter + step) % profile.counter_period
            data_id = spec.data_id ^ (kind == "other data id")
            data = profile.protect(bytes(spec.length), data_id=data_id, counter=counter)
            if kind == "wrong crc":
                data = data[:-1] + bytes([data[-1] ^ 0x10])
            if kind == "other length":
                data = data[:7]
            identifier = spec.frame_id + (kind == "other id")
            frames.append(
                Frame(frame_id=identifier, data=data, is_extended=kind == "29 bits", timestamp_ns=len(periods))
            )
        periods.append(frames)
    return periods


def state_of(parts, receiver) -> ReceiverState:
    """The C state as the Python one."""
    return ReceiverState(
        stream=STREAMS[receiver.stream],
        last_counter=receiver.last_counter if receiver.has_counter else None,
        window=tuple(Check(value) for value in list(receiver.window)[: receiver.checks]),
        counts=tuple(receiver.counts),
    )


def accepted_of(parts, receiver, frames: list[Frame]) -> Frame | None:
    given_frames = parts.frames(frames)
    found = parts.lib.sw_receive(receiver, given_frames, len(frames))
    if found == parts.ffi.NULL:
        return None
    return frames[found - parts.ffi.cast("sw_frame *", given_frames)]


@given(story=PERIODS)
@example(story=[[("good", 1)]] * 3 + [[("wrong crc", 0)]] * 9 + [[]] * 9 + [[("good", 1)]] * 9)
@examples(300)
def test_every_period_of_a_stream_leaves_pythons_state(parts, story):
    spec, config = parts.messages.pressure.spec, parts.config.bus.e2e
    receiver, state = parts.ffi.new("sw_receiver *"), ReceiverState()
    for frames in stream_of(parts, story):
        state, reception = receive(state, frames, spec=spec, config=config)
        assert accepted_of(parts, receiver, frames) == reception.accepted
        assert state_of(parts, receiver) == state


def test_every_step_of_the_counter_gets_its_check(parts):
    """From every counter to every counter: AUTOSAR's profile check with a MaxDeltaCounter, by its definition."""
    spec, config = parts.messages.pressure.spec, parts.config.bus.e2e
    periods = profile_of(spec).counter_period
    for last in (0, 1, periods // 2, periods - 1):
        for step in range(periods):
            receiver = parts.ffi.new("sw_receiver *")
            for counter in (last, (last + step) % periods):
                data = profile_of(spec).protect(bytes(spec.length), data_id=spec.data_id, counter=counter)
                frame = Frame(frame_id=spec.frame_id, data=data)
                accepted = accepted_of(parts, receiver, [frame])
            expected = Check.OK if step == 1 else Check.OK_SOME_LOST if 1 < step <= config.max_delta else None
            expected = expected or (Check.REPEATED if step == 0 else Check.WRONG_SEQUENCE)
            assert receiver.window[1] == expected.value
            assert receiver.last_counter == (last + step) % periods
            assert (accepted is not None) == (expected in GOOD)


@pytest.mark.parametrize("length", range(65))
def test_no_length_is_misread(parts, length):
    """Lengths that no length code names, too; memory behind them holds a sound message."""
    spec = parts.messages.pressure.spec
    data = profile_of(spec).protect(bytes(spec.length), data_id=spec.data_id, counter=1)
    raw = {"id": spec.frame_id, "length": length, "data": data}
    receiver = parts.ffi.new("sw_receiver *")
    found = parts.lib.sw_receive(receiver, parts.ffi.new("sw_frame *", raw), 1)
    assert (found != parts.ffi.NULL) == (length == spec.length)
    assert receiver.counts[Check.ERROR.value] == (length != spec.length)
    assert spec.length in FD_LENGTHS


@given(
    identifier=st.integers(0, 2**32 - 1),
    extended=st.integers(0, 255),
    length=st.integers(0, 255),
    data=st.binary(min_size=64, max_size=64),
    timestamp=st.integers(-(2**63), 2**63 - 1),
)
def test_frames_that_no_bus_carries_do_no_harm(parts, identifier, extended, length, data, timestamp):
    """Whatever a driver hands over: UBSan watches, and nothing random is accepted."""
    spec = parts.messages.pressure.spec
    for known in (identifier, spec.frame_id):
        raw = {"id": known, "is_extended": extended, "length": length, "data": data, "timestamp_ns": timestamp}
        receiver = parts.ffi.new("sw_receiver *")
        found = parts.lib.sw_receive(receiver, parts.ffi.new("sw_frame *", raw), 1)
        if known != spec.frame_id or extended:
            assert list(receiver.counts) == [0, 0, 0, 0, 0, 1]
        sound = length == spec.length and profile_of(spec).check(data[:length], data_id=spec.data_id)
        assert (found != parts.ffi.NULL) == (sound and known == spec.frame_id and not extended)


@pytest.mark.parametrize("check", Check)
def test_counts_stay_at_their_largest(parts, check):
    spec = parts.messages.pressure.spec
    receiver = parts.ffi.new("sw_receiver *", {"counts": [2**32 - 2] * 6, "has_counter": 1, "last_counter": 3})
    counters = {Check.OK: 1, Check.OK_SOME_LOST: 2, Check.REPEATED: 0, Check.WRONG_SEQUENCE: 9}
    for _ in range(3):
        receiver.last_counter = 3
        data = profile_of(spec).protect(bytes(spec.length), data_id=spec.data_id, counter=3 + counters.get(check, 1))
        if check is Check.ERROR:
            data = bytes(spec.length)
        frames = [] if check is Check.NO_NEW_DATA else [Frame(frame_id=spec.frame_id, data=data)]
        parts.lib.sw_receive(receiver, parts.frames(frames), len(frames))
    assert [count == 2**32 - 1 for count in receiver.counts] == [other is check for other in Check]
