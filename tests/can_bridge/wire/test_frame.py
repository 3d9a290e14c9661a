from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire.frame import Frame
from tests.refused import refused


@given(frame_id=st.integers(-5, 0x805), length=st.integers(0, 70), time=st.integers(-3, 3), is_fd=st.booleans())
def test_exists_only_if_a_controller_could_send_it(frame_id, length, time, is_fd):
    # Lengths of a CAN FD length code, ISO 11898-1: written out once more on purpose.
    lengths = {0, 1, 2, 3, 4, 5, 6, 7, 8} | ({12, 16, 20, 24, 32, 48, 64} if is_fd else set())
    sound = 0 <= frame_id < 0x800 and length in lengths and time >= 0
    try:
        frame = Frame(frame_id=frame_id, data=bytes(length), timestamp_ns=time, is_fd=is_fd)
    except ValueError:
        assert not sound
    else:
        assert sound
        assert (frame.frame_id, len(frame.data), frame.timestamp_ns, frame.is_fd) == (frame_id, length, time, is_fd)


def test_refusal_names_the_value():
    cases: list[tuple[dict[str, Any], str]] = [({"frame_id": 0x800}, "0x800"), ({"data": bytearray(8)}, "bytearray")]
    for fields, culprit in cases:
        with refused(ValueError, culprit):
            Frame(**{"frame_id": 1, "data": b"", **fields})
