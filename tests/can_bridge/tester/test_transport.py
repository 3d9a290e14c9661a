"""udsoncan and can-isotp over a bus of python-can, the ECU's own endpoint and server at the other end."""

import os
import time
from collections.abc import Iterator
from typing import Any

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.tester import asking
from can_bridge.tester.messages import NoAnswerError
from can_bridge.tester.sequence import End, Flashing
from can_bridge.tester.transfer import BLOCK_STEP, BlockLength
from can_bridge.tester.transport import answers, open_client
from can_bridge.uds.services import MAX_BLOCK, Did
from contract.config.diagnosis import CanId, DiagnosisConfig
from contract.config.vehicle import BusConfig
from tests.can_bridge.flashing.releases import image
from tests.can_bridge.flashing.store_ecu import KEY
from tests.can_bridge.tester.ecus import EcuToFlash
from tests.can_bridge.tester.served import served
from tests.examples import examples

NEW = image("new")


@pytest.fixture(params=["fd", "classic"])
def config(request: Any) -> BusConfig:
    """CAN FD with the usual identifiers, classic with others of 29 bits."""
    ids = DiagnosisConfig()
    if request.param == "classic":
        ids = DiagnosisConfig(request_id="0x18DA5AF1", response_id="0x18DAF15A")
    channel = f"tester-{os.getpid()}-{request.param}"
    return BusConfig(interface="virtual", channel=channel, frames=request.param, diagnosis=ids)


@pytest.fixture
def listener(config: BusConfig) -> Iterator[can.BusABC]:
    protocol = can.CanProtocol.CAN_FD if config.frames == "fd" else can.CanProtocol.CAN_20
    with can.Bus(interface="virtual", channel=config.channel, protocol=protocol) as bus:
        yield bus


@pytest.mark.slow
def test_a_release_is_flashed_and_lost_and_doubled_frames_only_cost_time(
    config: BusConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    # What is not answered in this test was lost: nothing is slow.
    monkeypatch.setattr(asking, "P2_S", 0.2)
    monkeypatch.setattr("can_bridge.tester.transport.FLOW_CONTROL_MS", 50)
    rate, ecu = 0.006 if config.frames == "fd" else 0.0009, EcuToFlash()
    with served(ecu, config, lost=rate, doubled=rate) as count, open_client(config) as client:
        ours = asking.Asking(client, key=KEY.answer, clock=time.monotonic, sleep=time.sleep)
        done = Flashing(ours, NEW).run()
    assert (done.end, ecu.runs) == (End.CONFIRMED, "new")
    assert done.unanswered > 0
    # Frames are filled: all but the first of a block carry 63 or 7 bytes.
    assert count() > len(NEW) / (63 if config.frames == "fd" else 7)


def test_requests_fill_frames_and_other_answers_are_dropped(config: BusConfig, listener: can.BusABC) -> None:
    """ISO 15765-2: single frames are padded to 8 bytes."""

    def say(data: bytes, to: CanId = config.diagnosis.response) -> None:
        listener.send(can.Message(arbitration_id=to.number, data=data, is_extended_id=to.is_extended))

    def answer(*payload: int) -> None:
        say(bytes([len(payload), *payload]).ljust(8, b"\0"))

    with open_client(config) as client:
        client.conn.send(b"\x36\x02\x00")
        # Another node's, whose number is the same.
        say(b"\x02\x76\x02", CanId(config.diagnosis.response.number & 0x7FF, config.frames == "fd"))
        answer(0x76, 1)
        answer(0x7F, 0x31, 0x22)
        answer(0x76, 2)
        assert client.conn.wait_frame(timeout=1.0) == b"\x76\x02"
        message = listener.recv(1.0)
        assert message is not None
        assert CanId(message.arbitration_id, message.is_extended_id) == config.diagnosis.request
        assert message.is_fd == (config.frames == "fd")
        assert bytes(message.data) == b"\x03\x36\x02\x00" + bytes([0xCC] * 4)
        for garbage in (b"", b"\x00", b"\x10", b"\x21\x01", b"\x30", b"\x33\x00\x00", b"\xff" * 8):
            client.conn.send(b"\x3e\x00")
            say(garbage)
            began = time.monotonic()
            assert client.conn.wait_frame(timeout=0.05) is None, garbage
            assert time.monotonic() - began < 5.0


def test_a_bus_without_an_ecu_is_reported_after_a_few_requests_and_no_warning_of_a_library_reaches_the_terminal(
    config: BusConfig, listener: can.BusABC, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(asking, "P2_S", 0.01)
    with open_client(config) as client, pytest.raises(NoAnswerError, match="no ECU answers on this bus"):
        asking.Asking(client, key=None, clock=time.monotonic, sleep=time.sleep).read(Did.HARDWARE)
    requests = iter(lambda: listener.recv(0.0), None)
    assert sum(one.arbitration_id == config.diagnosis.request.number for one in requests) == asking.TIMES
    assert capfd.readouterr().err == ""


CASES = """
3602aa 7602 yes
3602aa 7601 no
3602aa 7f3673 yes
3602aa 7f3122 no
22f191 62f19141 yes
22f191 62f18641 no
3101ff00 7101ff0000000000 yes
3101ff00 7101ff0100 no
2701 670101 yes
2701 6702 no
37 77 yes
190209 59027f yes
1904d1018701 5904d101872f yes
1904d1018701 59041106862f no
1906d10187ff 5904d101872f no
8502 c502 yes
3400440000 74200ff0 yes
1002 5002003201f4 yes
1002 5003003201f4 no
1101 5101 yes
37 7f no
37 7f37 no
3602aa 76 no
"""


def test_a_response_is_matched_by_what_it_repeats():
    """The layout of ISO 14229-1's positive and negative responses."""
    for case in CASES.split("\n")[1:-1]:
        request, response, is_answer = case.split()
        assert answers(bytes.fromhex(request), bytes.fromhex(response)) is (is_answer == "yes"), case
    assert not answers(b"\x37", b"") and not answers(b"", b"\x77")


@given(
    limit=st.integers(0, 10_000),
    fates=st.lists(st.booleans(), max_size=200),
    offsets=st.lists(st.integers(0, 10**6), min_size=1, max_size=5),
)
@examples(40)
def test_blocks_fit_a_request_end_at_words_shrink_and_grow(limit: int, fates: list[bool], offsets: list[int]) -> None:
    length = BlockLength()
    length.allow(limit)
    for fate in fates:
        (length.arrived if fate else length.lost)()
    for offset in offsets:
        size = length.next_from(offset)
        assert 1 <= size <= min(max(BLOCK_STEP, limit - 2), MAX_BLOCK - 2)
        assert (offset + size) % BLOCK_STEP == 0
    longest = max(BLOCK_STEP, (min(limit, MAX_BLOCK) - 2) // BLOCK_STEP * BLOCK_STEP)
    for report, count, expected in ((length.lost, 10, BLOCK_STEP), (length.arrived, 1000, longest)):
        for _ in range(count):
            report()
        assert length.next_from(0) == expected
