"""From what a backend hears to a parsed message: nothing raises, all is counted, and genuine frames come through."""

import struct

import can
from can.interfaces.udp_multicast.utils import pack_message
from hypothesis import example, given
from hypothesis import strategies as st

from can_bridge.bus.conversion import to_message
from can_bridge.e2e.sender import E2eSender
from can_bridge.secoc.freshness import Freshness
from can_bridge.secoc.node import secured
from can_bridge.wire.frame import Frame
from tests.examples import examples
from tests.fuzz.receive_path import follow
from tests.proofs.bus.receive_path import KEY, MESSAGES, ReceivePath


def genuine(count: int) -> list[Frame]:
    """Of all messages of the three sets in turn, their counters in step."""
    senders = [E2eSender(message.spec) for message in MESSAGES]
    frames = [
        senders[i % len(senders)].frame(bytes(MESSAGES[i % len(senders)].spec.protected), now_ns=i)
        for i in range(count)
    ]
    return [
        secured(frame, spec=sender.spec, key=KEY if sender.spec.is_secured else None, freshness=Freshness(count=i))
        for i, (frame, sender) in enumerate(zip(frames, senders * count, strict=False))
    ]


SOUND_DATAGRAM = pack_message(to_message(genuine(1)[0]))
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
def test_any_input_is_followed_to_its_end(content):
    follow(content)


@given(st.lists(st.binary(max_size=60), max_size=10), st.integers(1, 20))
def test_genuine_frames_between_garbage_arrive_in_their_order(garbage, count):
    frames = genuine(count)
    path = ReceivePath()
    noise = [*garbage, b"", b"\xc1"]
    sent = []
    for i, frame in enumerate(frames):
        sent += [noise[i % len(noise)], pack_message(to_message(frame))]
    got = [(frame.frame_id, frame.data, frame.is_fd) for frame in path.datagrams(sent)]
    expected = [(frame.frame_id, frame.data, frame.is_fd) for frame in frames]
    # Noise that happens to be a frame would come too; binary noise of 60 bytes is none.
    assert got == expected
    assert path.udp.received == path.fed == 2 * count
    lines = b"".join(noise[i % len(noise)].replace(b"\r", b"") + b"\r" + line(frame) for i, frame in enumerate(frames))
    assert [(frame.frame_id, frame.data, frame.is_fd) for frame in path.lines(lines)] == expected
    # Those of the lines are the datagrams' over again: not fresh.
    assert sorted(frame.data for frame in path.authentic) == sorted(
        frame.data for frame, message in zip(frames, MESSAGES * count, strict=False) if message.spec.is_secured
    )


def line(frame: Frame) -> bytes:
    code = can.util.len2dlc(len(frame.data))
    return f"{'b' if frame.is_fd else 't'}{frame.frame_id:03X}{code:X}{frame.data.hex()}\r".encode()
