"""From what a backend hears to a parsed message: nothing raises, all is counted. Genuine frames among damaged ones are
followed in `tests/proofs/bus/fuzz.py`.
"""

import struct

import pytest
from can.interfaces.udp_multicast.utils import pack_message
from hypothesis import example, given
from hypothesis import strategies as st

from can_bridge.bus.conversion import to_message
from can_bridge.e2e.sender import E2eSender
from can_bridge.wire.message_specs import PRESSURE
from tests.examples import examples
from tests.fuzz.receive_path import follow

SOUND_DATAGRAM = pack_message(to_message(E2eSender(PRESSURE).frame(bytes(PRESSURE.protected), now_ns=0)))
SOUND_LINE = b"b1209" + bytes(12).hex().encode() + b"\r"

DAMAGED = st.builds(
    lambda sound, place, change: sound[: place % len(sound)] + change + sound[place % len(sound) + 1 :],
    st.sampled_from([SOUND_DATAGRAM, SOUND_LINE]),
    st.integers(0, 300),
    st.binary(max_size=4),
)
RECORDS = st.builds(
    lambda frame_id, flags, time, length, data: struct.pack("<IBdB", frame_id, flags, time, length) + data,
    st.integers(0, 0x7FF) | st.integers(0, 2**32 - 1),
    st.integers(0, 31),
    st.floats(),
    st.integers(0, 255),
    st.binary(max_size=70),
)


@examples(500)
@given(
    st.binary(max_size=300)
    | st.builds(bytes.__add__, st.sampled_from([b"\x00", b"\x60"]), DAMAGED)
    | RECORDS.map(b"\xff".__add__)
)
@example(b"\x60" + SOUND_LINE)
@example(b"\x00" + SOUND_DATAGRAM)
@example(b"\x60" + b"z\rt\a\r\r\a")
@pytest.mark.slow
def test_any_input_is_followed_to_its_end(content):
    follow(content)
