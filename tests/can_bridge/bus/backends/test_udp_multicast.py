"""The multicast backend on this machine's own network."""

import os
import socket
import tracemalloc
from collections.abc import Iterator
from typing import Any

import can
import msgpack  # type: ignore[import-untyped]  # ships none
import pytest
from can.interfaces.udp_multicast.utils import unpack_message
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.bus.backends.udp_multicast import RECEIVE_QUEUE, parse_datagram
from can_bridge.bus.conversion import to_message
from can_bridge.bus.interface import Rejection
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from tests.can_bridge.bus.backends.peers import collected

GROUP = f"239.74.{os.getpid() >> 8 & 0xFF}.{os.getpid() & 0xFF}"
"""Another one for each process, as other tests run at the same time."""

FRAME_ID = 0x5A5

SOUND = {"arbitration_id": 0x120, "data": bytes(16), "is_fd": True, "is_extended_id": False}


@pytest.fixture
def pair() -> Iterator[tuple[PythonCanBus, PythonCanBus]]:
    config = BusConfig(interface="udp_multicast", channel=GROUP)
    try:
        one, other = PythonCanBus.open(config), PythonCanBus.open(config)
    except BusError as error:
        pytest.skip(f"no multicast here: {error}")
    with one, other:
        one.send(Frame(frame_id=FRAME_ID, data=b"is anyone there?"))
        if not collected(other, 1, FRAME_ID):
            pytest.skip("multicast does not loop back here")
        yield one, other


def test_own_frames_are_heard_again_and_left_out(pair):
    one, other = pair
    for i in range(20):
        one.send(Frame(frame_id=FRAME_ID, data=bytes([i])))
        other.send(Frame(frame_id=FRAME_ID, data=bytes([i + 100])))
    assert [frame.data[0] for frame in collected(one, 20, FRAME_ID)] == list(range(100, 120))
    assert [frame.data[0] for frame in collected(other, 20, FRAME_ID)] == list(range(20))
    for bus in pair:
        bus.receive_all()
    # One more: what the fixture sent.
    assert (one.rejected[Rejection.OWN], other.rejected[Rejection.OWN]) == (21, 20)
    # One that could not be sent is not waited for, or an equal one of another node would be taken for it.
    frame = Frame(frame_id=FRAME_ID, data=b"twin")
    sendto, one._bus._multicast.send = one._bus._multicast.send, None
    with pytest.raises(TypeError):
        one._bus.send(to_message(frame))
    one._bus._multicast.send = sendto
    other.send(frame)
    assert [got.data for got in collected(one, 1, FRAME_ID)] == [b"twin"]
    # Equal frames are no echoes: a tester sends no time, and ISO-TP's frames n and n + 16 of a run of zeros are equal.
    for i in range(64):
        one.send(Frame(frame_id=FRAME_ID, data=bytes([0x20 + i % 16, *bytes(7)])))
    assert [got.data[0] & 15 for got in collected(other, 64, FRAME_ID)] == [*range(16)] * 4


def test_what_the_kernel_had_to_drop_is_counted(pair):
    one, other = pair
    sock = other._bus._multicast._socket
    other.receive_all()
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    before, received = other.overflows, other.received
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        for i in range(200):
            sender.sendto(i.to_bytes(2, "big"), (GROUP, 43113))
    other.receive_all()
    lost = other.overflows - before
    assert lost > 0
    # Other tests may send to the group, too.
    assert other.received - received + lost >= 200
    one.receive_all()
    assert one.overflows == 0


def test_group_stays_on_this_machine_and_others_are_not_heard(pair):
    """Linux hands a socket, by default, the datagrams of all groups that anyone on the machine has joined."""
    one, other = pair
    multicast, option = other._bus._multicast, (socket.SOL_SOCKET, socket.SO_RCVBUF)
    assert multicast.hop_limit == 0
    # The system may grant a smaller queue than was asked for. Linux answers with twice what it grants.
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as default:
        assert default.getsockopt(*option) <= multicast._socket.getsockopt(*option) <= 2 * RECEIVE_QUEUE
    with PythonCanBus.open(BusConfig(interface="udp_multicast", channel="239.74.255.254")) as elsewhere:
        received = other.received
        elsewhere.send(Frame(frame_id=FRAME_ID, data=b"there"))
        one.send(Frame(frame_id=FRAME_ID, data=b"here"))
        assert [frame.data for frame in collected(other, 1, FRAME_ID)] == [b"here"]
        assert other.received == received + 1


FLAGS = ("is_extended_id", "is_remote_frame", "is_error_frame", "is_fd", "bitrate_switch", "error_state_indicator")
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.binary(max_size=70) | st.just("x"),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=4,
)
DATAGRAMS = st.binary(max_size=100) | st.builds(
    lambda likely, odd: msgpack.packb(SOUND | likely | odd),
    st.fixed_dictionaries({}, optional={"dlc": st.integers(0, 64), "data": st.binary(max_size=64)}),
    st.dictionaries(
        st.sampled_from(["arbitration_id", "data", "dlc", "timestamp", "channel", "unknown", *FLAGS]),
        VALUES | st.booleans(),
        max_size=3,
    ),
)


@given(DATAGRAMS)
def test_datagram_that_is_taken_means_what_python_can_reads_in_it(datagram):
    parsed = parse_datagram(datagram, timestamp=3.0)
    assert isinstance(parsed, Rejection | can.Message)
    if isinstance(parsed, can.Message):
        theirs = unpack_message(datagram, replace={"timestamp": 3.0}, check=True)
        assert parsed.equals(theirs, check_channel=False)


def test_why_a_datagram_is_refused():
    cases: dict[Rejection | None, list[dict[str, Any]]] = {
        None: [{}, {"is_error_frame": True}],
        Rejection.WRONG_LENGTH: [{"dlc": 15}, {"data": bytes(15)}, {"data": bytes(80)}, {"is_fd": False}],
        Rejection.GARBAGE: [
            *({"data": data} for data in (2**30, "text", [1, 2])),
            *({"arbitration_id": frame_id} for frame_id in (True, 0x800, -1, 1.0)),
            *({"is_fd": 1}, {"dlc": "16"}, {"surprise": 1}),
        ],
    }
    for reason, changes in cases.items():
        for change in changes:
            parsed = parse_datagram(msgpack.packb(SOUND | change))
            assert (parsed if isinstance(parsed, Rejection) else None) is reason, change


def test_small_datagram_cannot_ask_for_much_memory():
    """python-can's own parser makes a gigabyte of these few bytes; the others claim 2^32 - 1 entries or bytes."""
    asking = [msgpack.packb(SOUND | odd) for odd in ({"data": 2**30}, {"dlc": 2**62})]
    claims = [bytes([kind]) + b"\xff" * 4 for kind in (0xDF, 0xDD, 0xC6)]
    tracemalloc.start()
    try:
        assert all(isinstance(parse_datagram(one), Rejection) for one in (*asking, *claims, b"\x91" * 4000))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # Some objects of Python's, and what msgpack needs for a stack of 4,000.
    assert peak < 2**20
