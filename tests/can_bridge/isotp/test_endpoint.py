"""The endpoint by itself: frames as the standard's tables have them, written out by hand."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.isotp.endpoint import Endpoint
from can_bridge.isotp.settings import IsoTpSettings, classic
from can_bridge.wire.frame import FD_LENGTHS, Frame
from contract.errors import ConfigError
from tests.examples import examples

TESTER, ECU = 0x7E0, 0x7E8
CLASSIC = classic(receive_id=TESTER, send_id=ECU)
FD = IsoTpSettings(receive_id=TESTER, send_id=ECU)
MS = 1_000_000


def frame(text: str, *, frame_id: int = TESTER, is_fd: bool = False) -> Frame:
    return Frame(frame_id=frame_id, data=bytes.fromhex(text), is_fd=is_fd)


def texts(frames: list[Frame]) -> list[str]:
    return [each.data.hex(" ").upper() for each in frames]


def receive(endpoint: Endpoint, *frames: str, now_ns: int = 0) -> list[bytes]:
    for each in frames:
        endpoint.receive(now_ns, frame(each, is_fd=len(bytes.fromhex(each)) > 8))
    return endpoint.take()


def test_a_message_that_fits_is_one_frame():
    endpoint = Endpoint(CLASSIC)
    assert receive(endpoint, "02 3E 80 CC CC CC CC CC") == [b"\x3e\x80"]
    assert endpoint.send(b"\x7e\x00")
    assert endpoint.poll(0) == [Frame(frame_id=ECU, data=bytes.fromhex("027E00CCCCCCCCCC"), is_fd=False)]
    assert endpoint.is_idle


def test_our_block_size_and_separation_time_are_said_and_kept():
    endpoint = Endpoint(replace(CLASSIC, block_size=2, separation_code=0xF3))
    receive(endpoint, "10 1B 00 00 00 00 00 00")
    assert texts(endpoint.poll(0)) == ["30 02 F3 CC CC CC CC CC"]
    receive(endpoint, "21" + "00" * 7)
    assert endpoint.poll(0) == []
    receive(endpoint, "22" + "00" * 7)
    assert texts(endpoint.poll(0)) == ["30 02 F3 CC CC CC CC CC"]
    assert receive(endpoint, "23" + "00" * 7) == [bytes(27)]
    assert endpoint.poll(0) == []


def test_the_others_block_size_is_kept():
    endpoint = Endpoint(CLASSIC)
    endpoint.send(bytes(range(34)))
    assert texts(endpoint.poll(0)) == ["10 22 00 01 02 03 04 05"]
    assert endpoint.poll(0) == []
    receive(endpoint, "30 03 00")
    assert [text[:2] for text in texts(endpoint.poll(0))] == ["21", "22", "23"]
    assert endpoint.poll(0) == []
    receive(endpoint, "30 00 00")
    assert texts(endpoint.poll(0)) == ["24 1B 1C 1D 1E 1F 20 21"]
    assert endpoint.is_idle


def test_the_others_separation_time_is_kept():
    reserved = dict.fromkeys(("80", "F0", "FA", "FF"), 127 * MS)
    gaps = {"00": 0, "01": MS, "7F": 127 * MS, "F1": 100_000, "F9": 900_000, **reserved}
    for code, gap_ns in gaps.items():
        endpoint = Endpoint(CLASSIC)
        endpoint.send(bytes(20))
        endpoint.poll(0)
        receive(endpoint, f"30 00 {code}", now_ns=5)
        assert len(endpoint.poll(5)) == (2 if gap_ns == 0 else 1), code
        if gap_ns:
            assert endpoint.poll(5 + gap_ns - 1) == [], code
            assert len(endpoint.poll(5 + gap_ns)) == 1, code


def test_the_first_frame_of_a_block_need_not_wait():
    endpoint = Endpoint(CLASSIC)
    endpoint.send(bytes(20))
    endpoint.poll(0)
    receive(endpoint, "30 01 7F")
    assert len(endpoint.poll(0)) == 1
    receive(endpoint, "30 01 7F", now_ns=1)
    assert len(endpoint.poll(1)) == 1


def test_waits_are_obeyed_and_counted():
    endpoint = Endpoint(replace(CLASSIC, max_waits=2))
    endpoint.send(bytes(20))
    endpoint.poll(0)
    for now_ns in (900 * MS, 1800 * MS):
        receive(endpoint, "31 00 00", now_ns=now_ns)
        assert endpoint.poll(now_ns) == []
    receive(endpoint, "30 01 00", now_ns=2700 * MS)
    assert len(endpoint.poll(2700 * MS)) == 1
    for now_ns in (3600 * MS, 4500 * MS):
        receive(endpoint, "31 00 00", now_ns=now_ns)
    receive(endpoint, "30 00 00", now_ns=4500 * MS)
    assert len(endpoint.poll(4500 * MS)) == 1
    assert endpoint.is_idle


def test_too_many_waits_end_a_message_and_the_next_one_may_wait_as_often():
    endpoint = Endpoint(replace(CLASSIC, max_waits=2))
    for _ in range(2):
        endpoint.send(bytes(20))
        assert len(endpoint.poll(0)) == 1
        receive(endpoint, "31 00 00", "31 00 00")
        assert not endpoint.is_idle
        receive(endpoint, "31 00 00")
        assert endpoint.is_idle
    endpoint.send(bytes(20))
    endpoint.poll(0)
    receive(endpoint, "31 00 00", "31 00 00", "31 00 00", "30 00 00")
    assert endpoint.poll(0) == []
    assert endpoint.losses.aborted_transmissions == 3


def test_overflow_and_reserved_answers_end_a_message_and_the_next_one_follows():
    for answer in ("32 00 00", "33 00 00", "3F 00 00"):
        endpoint = Endpoint(CLASSIC)
        endpoint.send(bytes(20))
        endpoint.send(b"\x01")
        endpoint.poll(0)
        receive(endpoint, answer)
        assert texts(endpoint.poll(0)) == ["01 01 CC CC CC CC CC CC"], answer
        assert endpoint.losses.aborted_transmissions == 1


def test_a_transmission_without_flow_control_is_given_up():
    endpoint = Endpoint(CLASSIC)
    endpoint.send(bytes(20))
    endpoint.poll(0)
    assert endpoint.poll(1000 * MS) == []
    assert not endpoint.is_idle
    assert endpoint.poll(1000 * MS + 1) == []
    assert endpoint.is_idle
    receive(endpoint, "30 00 00", now_ns=1001 * MS)
    assert endpoint.poll(1001 * MS) == []


def test_a_reception_without_a_next_frame_is_given_up():
    endpoint = Endpoint(CLASSIC)
    for late_ns, found in ((0, [bytes(20)]), (1, [])):
        receive(endpoint, "10 14" + "00" * 6)
        receive(endpoint, "21" + "00" * 7, now_ns=1000 * MS)
        assert receive(endpoint, "22" + "00" * 7, now_ns=2000 * MS + late_ns) == found
        assert endpoint.losses.aborted_receptions == late_ns


def test_no_flow_control_for_a_message_that_is_over():
    endpoint = Endpoint(CLASSIC)
    receive(endpoint, "10 14" + "00" * 6)
    assert endpoint.poll(1001 * MS) == []


def test_a_wrong_sequence_number_ends_a_message():
    for number in set(range(16)) - {1}:
        endpoint = Endpoint(CLASSIC)
        receive(endpoint, "10 0A" + "00" * 6)
        assert receive(endpoint, f"2{number:X}" + "00" * 7, "21" + "00" * 7) == [], number
        assert endpoint.losses.aborted_receptions == 1


def test_a_new_message_replaces_one_that_is_on_the_way():
    for new, message in (("02 AA BB", b"\xaa\xbb"), ("10 08 AA AA AA AA AA AA", b"\xaa" * 8)):
        endpoint = Endpoint(CLASSIC)
        receive(endpoint, "10 0A" + "00" * 6)
        assert receive(endpoint, new, "21 AA AA") == [message]
        assert endpoint.losses.aborted_receptions == 1


def test_too_long_a_message_is_answered_by_overflow():
    endpoint = Endpoint(replace(CLASSIC, max_message=9))
    assert receive(endpoint, "10 09" + "00" * 6, "21" + "00" * 7) == [bytes(9)]
    receive(endpoint, "10 0A" + "00" * 6)
    assert texts(endpoint.poll(0)) == ["32 00 00 CC CC CC CC CC"]
    assert receive(endpoint, "21" + "00" * 7) == []
    assert receive(Endpoint(replace(FD, max_message=8)), "00 09" + "00" * 10, "00 08" + "00" * 10) == [bytes(8)]
    receive(endpoint, "10 00 00 00 10 00 00 00")
    assert texts(endpoint.poll(0)) == ["32 00 00 CC CC CC CC CC"]


def test_what_the_standard_ignores_is_ignored():
    endpoint = Endpoint(FD)
    for ignored in (
        *("", "00", "00 00 00 00 00 00 00 00", "08 00 00 00 00 00 00 00", "03 AA AA"),
        *("00 00" + "00" * 10, "00 0B" + "00" * 10, "05 05" + "00" * 10),
        *("10 07" + "00" * 6, "10 0A 00", "10 3E" + "00" * 62, "10 00 00 00 00 0A 00 00"),
        *("30 00", "40 00 00", "F0 00 00"),
    ):
        receive(endpoint, "10 0A 00 01 02 03 04 05")
        endpoint.poll(0)
        assert receive(endpoint, ignored) == [], ignored
        assert endpoint.poll(0) == []
        assert receive(endpoint, "21 06 07 08 09") == [bytes(range(10))], ignored


def test_a_frame_shorter_than_the_first_one_ends_in_nothing():
    for length in (47, 11):
        endpoint = Endpoint(FD)
        receive(endpoint, "10 80" + "00" * 62)
        assert receive(endpoint, "21" + "00" * length, "22" + "00" * 63, "21" + "00" * 63) == []


def test_a_frame_longer_than_the_first_one_is_ignored():
    endpoint = Endpoint(FD)
    receive(endpoint, "10 0A" + "00" * 6)
    assert receive(endpoint, "21" + "AA" * 11) == []
    assert receive(endpoint, "21" + "00" * 7) == [bytes(10)]


def test_frames_of_others_are_ignored():
    endpoint = Endpoint(CLASSIC)
    for other in (
        frame("02 3E 80", frame_id=0x7DF),
        frame("02 3E 80", frame_id=ECU),
        Frame(frame_id=TESTER, data=b"\x01\x02", is_extended=True),
    ):
        endpoint.receive(0, other)
    assert endpoint.take() == []


def test_queues_are_bounded():
    endpoint = Endpoint(replace(CLASSIC, queue=2))
    assert [endpoint.send(b"\x00") for _ in range(4)] == [True, True, False, False]
    assert receive(endpoint, "01 01", "01 02", "01 03") == [b"\x01", b"\x02"]
    assert (endpoint.losses.dropped_sent, endpoint.losses.dropped_received) == (2, 1)
    assert len(endpoint.poll(0)) == 2


def test_a_poll_gives_out_no_more_than_a_burst():
    endpoint = Endpoint(replace(CLASSIC, burst=3))
    endpoint.send(bytes(6 + 7 * 7))
    endpoint.poll(0)
    receive(endpoint, "30 00 00")
    assert [len(endpoint.poll(0)) for _ in range(4)] == [3, 3, 1, 0]


def test_settings_and_lengths_that_the_standard_does_not_have_are_refused():
    for length in (0, 4096):
        with pytest.raises(ValueError, match=f"message of {length} bytes: must have 1..4095"):
            Endpoint(CLASSIC).send(bytes(length))
    changes: list[tuple[str, Any]] = [
        *(("receive_id", 0x800), ("send_id", -1), ("send_id", TESTER), ("frame_length", 9), ("frame_length", 7)),
        *(("is_fd", False), ("block_size", 256), ("separation_code", -1), ("max_message", 4096), ("queue", 0)),
        *(("burst", 0), ("n_bs_ns", 0), ("n_cr_ns", 0), ("max_waits", -1)),
    ]
    for name, value in changes:
        with pytest.raises(ConfigError, match=r"iso-tp: \w+ = "):
            replace(FD, **{name: value})


WIRE = st.sampled_from(FD_LENGTHS).flatmap(lambda length: st.binary(min_size=length, max_size=length))
LIKELY = st.tuples(
    st.sampled_from([b"\x02", b"\x10\x14", b"\x21", b"\x22", b"\x23", b"\x30\x00\x00", b"\x31\x00\x00"]),
    st.sampled_from([3, 8, 64]),
).map(lambda pair: pair[0].ljust(pair[1], b"\xaa"))


@examples(200)
@given(
    steps=st.lists(st.tuples(st.one_of(WIRE, LIKELY), st.integers(0, 2_000 * MS), st.booleans()), max_size=40),
    settings=st.sampled_from([CLASSIC, FD, replace(CLASSIC, block_size=1)]),
)
def test_whatever_comes_over_the_wire_nothing_is_raised_and_nothing_grows(steps, settings):
    endpoint = Endpoint(settings)
    now_ns = 0
    for data, pause_ns, sends in steps:
        now_ns += pause_ns
        if sends:
            endpoint.send(bytes(100))
        endpoint.receive(now_ns, Frame(frame_id=TESTER, data=data))
        frames = endpoint.poll(now_ns)
        assert len(frames) <= settings.burst
        assert all(len(each.data) >= 3 and each.frame_id == ECU for each in frames)
    messages = endpoint.take()
    assert len(messages) <= settings.queue
    assert all(0 < len(message) <= 4095 for message in messages)
    now_ns += 1001 * MS
    for _ in range(3 * settings.queue):
        endpoint.poll(now_ns)
        now_ns += 1001 * MS
    assert endpoint.is_idle
