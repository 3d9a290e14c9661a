import pickle
from dataclasses import replace
from itertools import product

import pytest

from can_bridge.e2e.profiles import PROFILE_5, profile_of
from can_bridge.e2e.receiver import E2eReceiver, FrameCheck, StreamState, receive
from can_bridge.e2e.sender import E2eSender, SenderState
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE, PRESSURE_CLASSIC, MessageSpec
from contract.config.vehicle import E2eConfig

CONFIG = E2eConfig(max_delta=4, window=5, min_ok=2, max_errors=2)


def good(counter: int, time_ns: int = 0, spec: MessageSpec = PRESSURE) -> Frame:
    profile = profile_of(spec)
    data = profile.protect(bytes(spec.length), data_id=spec.data_id, counter=counter % profile.counter_period)
    return Frame(frame_id=spec.frame_id, data=data, timestamp_ns=time_ns, is_fd=spec.is_fd)


def corrupt(counter: int) -> Frame:
    frame = good(counter)
    return replace(frame, data=frame.data[:-1] + bytes([frame.data[-1] ^ 1]))


def receiver(**changes: int) -> E2eReceiver:
    return E2eReceiver(PRESSURE, replace(CONFIG, **changes))


def valid_receiver(last: int = 9) -> E2eReceiver:
    made = receiver()
    for counter in range(last - 5, last + 1):
        made.tick([good(counter)])
    assert made.state.stream is StreamState.VALID
    return made


def test_every_counter_step_gets_its_check():
    """All steps of both counters, across the wrap; the first frame is good whatever its counter."""
    for spec, most, lasts in (
        *((PRESSURE, 4, (last,)) for last in (0, 1, 100, 252, 253, 254, 255)),
        *((PRESSURE_CLASSIC, most, range(16)) for most in (1, 4, 7)),
    ):
        period = profile_of(spec).counter_period
        expected = {0: FrameCheck.REPEATED, 1: FrameCheck.OK} | dict.fromkeys(
            range(2, most + 1), FrameCheck.OK_SOME_LOST
        )
        for last, step in product(lasts, range(period)):
            made = E2eReceiver(spec, replace(CONFIG, max_delta=most))
            assert made.tick([good(last, spec=spec)]).checks == (FrameCheck.OK,)
            reception = made.tick([good(last + step, step, spec)])
            assert reception.checks == (expected.get(step, FrameCheck.WRONG_SEQUENCE),), (spec.name, last, step)
            assert (reception.accepted is not None) == (1 <= step <= most), (spec.name, last, step)


def test_frame_that_fails_is_an_error_and_changes_no_counter():
    for frame in [
        corrupt(1),
        replace(good(1), data=good(1).data[:8]),
        replace(good(1), data=b""),
        replace(good(1), data=PROFILE_5.protect(bytes(16), data_id=JET_COMMAND.data_id, counter=1)),
    ]:
        made = receiver()
        made.tick([good(7)])
        reception = made.tick([frame])
        assert (reception.checks, reception.accepted) == ((FrameCheck.ERROR,), None), frame
        assert made.state.last_counter == 7, frame


def test_several_frames_in_a_period_are_all_checked_and_the_newest_good_one_counts():
    made = valid_receiver(last=9)
    reception = made.tick([good(10), good(11, time_ns=1), good(11, time_ns=2), corrupt(12)])
    assert reception.checks == (FrameCheck.OK, FrameCheck.OK, FrameCheck.REPEATED, FrameCheck.ERROR)
    assert reception.live == good(11, time_ns=1)
    # Rejected are periods with frames of which none was good.
    made = valid_receiver(last=9)
    for frames in ([corrupt(10)], [good(10), good(10)], [], [good(12)], [good(50)]):
        made.tick(frames)
    assert (made.state.frames_rejected, made.state.count(FrameCheck.ERROR)) == (3, 1)


def test_a_state_is_a_value():
    """Every mixture of frames leads on from a saved state as from the receiver itself."""
    made = receiver()
    for frames in ([], [good(1)], [corrupt(2)], [good(2), good(5)], [good(5)], [good(90)], [good(91)], [], []):
        before = made.state
        saved = pickle.loads(pickle.dumps(before))
        reception = made.tick(frames)
        after = receive(saved, frames, spec=PRESSURE, config=CONFIG)
        assert after == (made.state, reception)
        assert saved == before != made.state


def test_sender_and_receiver_agree_over_several_wraps():
    made, sender = receiver(), E2eSender(PRESSURE)
    for step in range(600):
        frame = sender.frame(bytes(PRESSURE.length), now_ns=step)
        assert (frame.timestamp_ns, frame.is_fd, frame.frame_id) == (step, True, PRESSURE.frame_id)
        assert made.tick([frame]).checks == (FrameCheck.OK,)
    assert sender.state == SenderState(counter=600 % 256)


def test_sender_refuses_another_length():
    with pytest.raises(ValueError, match="Pressure of 8 bytes: must have 16"):
        E2eSender(PRESSURE).frame(bytes(8), now_ns=0)
