import can
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.conversion import classified, to_message
from can_bridge.bus.rejection import Rejection
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, Frame

FRAMES = st.builds(
    lambda is_fd, frame_id, payload, pick, time: Frame(
        frame_id=frame_id,
        data=payload.ljust(64, b"\0")[: (FD_LENGTHS if is_fd else CLASSIC_LENGTHS)[pick % (16 if is_fd else 9)]],
        timestamp_ns=time,
        is_fd=is_fd,
    ),
    st.booleans(),
    st.integers(0, 0x7FF),
    st.binary(max_size=64),
    st.integers(0, 15),
    # Twelve days: as far as a time in float seconds is exact to the ns.
    st.integers(0, 10**15),
)

ODD = st.none() | st.booleans() | st.integers() | st.floats() | st.sampled_from(["", "1", "x"])


@given(FRAMES)
def test_frame_survives_the_conversion_to_a_message_and_back(frame):
    message = to_message(frame)
    message._check()
    assert message.bitrate_switch == message.is_fd == frame.is_fd
    assert classified(message) == frame


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8))
def test_extended_identifiers_are_told_to_python_can_and_refused_from_it(frame_id, data):
    message = to_message(Frame(frame_id=frame_id, data=data, is_fd=False, is_extended=True))
    message._check()
    assert (message.is_extended_id, message.arbitration_id) == (True, frame_id)
    assert classified(message) is Rejection.EXTENDED


@given(
    st.fixed_dictionaries(
        {},
        optional={
            name: ODD
            for name in [
                "arbitration_id",
                "timestamp",
                "dlc",
                "is_fd",
                "is_extended_id",
                "is_remote_frame",
                "is_error_frame",
            ]
        },
    ),
    st.binary(max_size=70),
)
def test_message_of_any_values_is_classified(fields, data):
    """And a frame comes out only if python-can finds the message sound, too."""
    message = can.Message(data=data, **fields)
    found = classified(message)
    assert isinstance(found, Frame | Rejection)
    if isinstance(found, Frame):
        message.error_state_indicator = False
        message._check()
