import can
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.conversion import frame_of, to_message
from can_bridge.bus.interface import Rejection
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, Frame

ODD = st.none() | st.booleans() | st.integers() | st.floats() | st.sampled_from(["", "1", "x"])
FIELDS = ("arbitration_id", "timestamp", "dlc", "is_fd", "is_extended_id", "is_remote_frame", "is_error_frame")


# Twelve days: as far as a time in float seconds is exact to the ns.
@given(st.booleans(), st.integers(0, 0x1FFFFFFF), st.binary(max_size=64), st.integers(0, 15), st.integers(0, 10**15))
def test_frame_survives_the_conversion(is_fd, frame_id, payload, pick, time_ns):
    length = FD_LENGTHS[pick] if is_fd else CLASSIC_LENGTHS[pick % 9]
    data = payload.ljust(64, b"\0")[:length]
    frame = Frame(frame_id=frame_id % 0x800, data=data, timestamp_ns=time_ns, is_fd=is_fd)
    message = to_message(frame)
    message._check()
    assert message.bitrate_switch == message.is_fd == is_fd
    assert frame_of(message) == frame
    message = to_message(Frame(frame_id=frame_id, data=data, is_fd=is_fd, is_extended=True))
    message._check()
    assert (message.is_extended_id, message.arbitration_id) == (True, frame_id)
    assert frame_of(message) == Frame(frame_id=frame_id, data=data, is_fd=is_fd, is_extended=True)


@given(st.dictionaries(st.sampled_from(FIELDS), ODD), st.binary(max_size=70))
def test_message_of_any_values_is_classified(fields, data):
    """And a frame comes out only if python-can finds the message sound, too."""
    message = can.Message(data=data, **fields)
    frame = frame_of(message)
    assert isinstance(frame, Frame | Rejection)
    if isinstance(frame, Frame):
        message.error_state_indicator = False
        message.timestamp = frame.timestamp_ns / 1e9  # a time just before 0 rounds to 0
        message._check()
