from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.secoc.key import Key
from can_bridge.secoc.receiver import VerifierState, verified
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
    for trip, count, passes in [
        (2, 100, False),
        (2, 99, False),
        (2, 101, True),
        (2, 5000, True),
        (1, 101, False),
        (3, 0, True),
        (1 << 31, 0, True),
    ]:
        before = VerifierState(freshness=2 << 32 | 100)
        frame = genuine(SPEC, trip=trip, count=count)
        found = verified(before, [frame], spec=SPEC, key=key)
        assert list(found.frames) == ([frame] if passes else []), (trip, count, passes)
        assert found.none_authentic is not passes, (trip, count, passes)
        assert found.state.not_fresh == (not passes), (trip, count, passes)
        assert found.state.not_authentic == 0, (trip, count, passes)


def test_forged_repeated_and_reflected_frames_are_dropped_and_counted_apart(genuine, key):
    real = [genuine(SPEC, count=count) for count in (0, 1)]
    reflected = replace(genuine(JET_COMMAND_SECURED, count=9), frame_id=SPEC.frame_id)
    strange = genuine(SPEC, count=9, by=Key(SECRET[::-1]))
    frames = [forged(real[1]), real[0], real[0], reflected, real[1], strange, real[0]]
    found = verified(VerifierState(), frames, spec=SPEC, key=key)
    assert list(found.frames) == real
    assert (found.state.not_authentic, found.state.not_fresh, found.state.refused) == (3, 2, 5)
    assert not found.none_authentic


def test_frames_of_other_messages_are_passed_on_unseen(genuine, key):
    others = [
        genuine(JET_COMMAND_SECURED),
        Frame(frame_id=0x7FF, data=b""),
        replace(genuine(SPEC), is_extended=True),
    ]
    found = verified(VerifierState(), others, spec=SPEC, key=key)
    assert found == (VerifierState(), others, False)


def test_silence_is_no_sign_of_another_key(key):
    before = VerifierState(freshness=9, not_authentic=4, not_fresh=5)
    assert verified(before, [], spec=SPEC, key=key) == (before, [], False)


def test_without_a_key_everything_passes():
    frames = [Frame(frame_id=PRESSURE.frame_id, data=bytes(16))]
    assert verified(VerifierState(), frames, spec=PRESSURE, key=None) == (VerifierState(), frames, False)


@given(order=st.lists(st.integers(0, 8), max_size=30))
def test_whatever_the_order_each_value_passes_at_most_once_and_in_order(order, genuine, key):
    found = verified(VerifierState(), [genuine(SPEC, count=count) for count in order], spec=SPEC, key=key)
    passed = [frame.timestamp_ns for frame in found.frames]
    assert passed == sorted(set(passed))
    assert found.state.not_fresh == len(order) - len(passed)
    # The running maximum, as the definition has it.
    records = [count for at, count in enumerate(order) if all(count > earlier for earlier in order[:at])]
    assert passed == records
