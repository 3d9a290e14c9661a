from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import VerifierState, verified
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND_SECURED, PRESSURE, PRESSURE_SECURED
from tests.can_bridge.secoc.conftest import SECRET

SPEC = PRESSURE_SECURED


def forged(frame: Frame) -> Frame:
    return replace(frame, data=frame.data[:-1] + bytes([frame.data[-1] ^ 1]))


def test_genuine_frames_pass_and_are_remembered(genuine, key):
    frames = [genuine(SPEC, count=count) for count in (0, 1, 5)]
    found = verified(VerifierState(), frames, spec=SPEC, key=key)
    assert (list(found.frames), found.none_authentic) == (frames, False)
    assert found.state == VerifierState(freshness=(1 << 32) + 5)


def test_only_a_greater_freshness_is_fresh(genuine, key):
    before = VerifierState(freshness=2 << 32 | 100)
    stale, fresh = [(2, 100), (2, 99), (1, 101)], [(2, 101), (2, 5000), (3, 0), (1 << 31, 0)]
    for trip, count in stale + fresh:
        passes = (trip, count) in fresh
        frame = genuine(SPEC, trip=trip, count=count)
        judged = verified(before, [frame], spec=SPEC, key=key)
        assert list(judged.frames) == ([frame] if passes else []), (trip, count)
        assert judged.none_authentic is not passes, (trip, count)
        assert (judged.state.not_fresh, judged.state.not_authentic) == (not passes, 0), (trip, count)


def test_forged_repeated_and_reflected_frames_are_dropped_and_counted_apart(genuine, key):
    real = [genuine(SPEC, count=count) for count in (0, 1)]
    reflected = replace(genuine(JET_COMMAND_SECURED, count=9), frame_id=SPEC.frame_id)
    strange = genuine(SPEC, count=9, by=Key(SECRET[::-1]))
    frames = [forged(real[1]), real[0], real[0], reflected, real[1], strange, real[0]]
    found = verified(VerifierState(), frames, spec=SPEC, key=key)
    assert list(found.frames) == real
    assert (found.state.not_authentic, found.state.not_fresh, found.state.refused) == (3, 2, 5)
    assert not found.none_authentic


def test_frames_of_other_messages_silence_and_no_key_change_nothing(genuine, key):
    before = VerifierState(freshness=9, not_authentic=4, not_fresh=5)
    others = [genuine(JET_COMMAND_SECURED), Frame(frame_id=0x7FF, data=b""), replace(genuine(SPEC), is_extended=True)]
    for frames in (others, []):
        assert verified(before, frames, spec=SPEC, key=key) == (before, frames, False)
    plain = [Frame(frame_id=PRESSURE.frame_id, data=bytes(16))]
    assert verified(before, plain, spec=PRESSURE, key=None) == (before, plain, False)


@given(order=st.lists(st.integers(0, 8), max_size=30))
def test_whatever_the_order_each_value_passes_at_most_once_and_in_order(order, genuine, key):
    found = verified(VerifierState(), [genuine(SPEC, count=count) for count in order], spec=SPEC, key=key)
    passed = [frame.timestamp_ns for frame in found.frames]
    assert passed == sorted(set(passed))
    assert found.state.not_fresh == len(order) - len(passed)
    # The running maximum, as the definition has it.
    records = [count for at, count in enumerate(order) if all(count > earlier for earlier in order[:at])]
    assert passed == records
