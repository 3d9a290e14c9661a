"""The serial backend over a pseudo-terminal."""

import os
import time
from collections.abc import Iterator
from dataclasses import replace

import pytest
from hypothesis import given

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.bus.backends.slcan import LINE_LIMIT, SlcanBus, why_refused
from can_bridge.bus.interface import Rejection
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from tests.can_bridge.bus.backends.peers import PATIENCE_S, Adapter, adapter, collected, rejections
from tests.can_bridge.can_messages import can_messages
from tests.refused import refused

FRAME = Frame(frame_id=0x120, data=bytes(range(12)))
LINE = b"b1209000102030405060708090A0B\r"

BAD_LINES = {
    Rejection.GARBAGE: (
        # Identifiers: no digits, none, cut, a blank, an underscore; bytes that are no text; 12 and 30 bits.
        *(b"tzzz1AA\r", b"t\r", b"t12\r", b"t1 210AA\r", b"t1_21AA\r"),
        *(b"b12\xff\xfe\r", b"t8001AA\r", b"T200000001AA\r", b"hello\r", b"t12\a"),
    ),
    # A byte too few, half a byte, a byte too many, nine bytes in classic CAN.
    Rejection.WRONG_LENGTH: (b"t1233AABB\r", b"t1231A\r", b"t1231AABB\r", b"t1239" + b"AA" * 9 + b"\r"),
    Rejection.REMOTE: (b"r1208\r", b"R000001208\r"),
    # The second one is CANDapter's.
    Rejection.EXTENDED: (b"T000001201AA\r", b"x000001201AA\r", b"B000001201AA\r"),
    Rejection.WRONG_FORMAT: (b"t1301AA\r",),
    Rejection.ADAPTER: (b"\a",),
}


@pytest.fixture
def line() -> Iterator[Adapter]:
    with adapter() as end:
        yield end


@pytest.fixture
def bus(line: Adapter) -> Iterator[PythonCanBus]:
    with PythonCanBus.open(BusConfig(interface="slcan", channel=line.port)) as bus:
        assert line.read(b"O\r", 2) == b"C\rS6\rY2\rO\rO\r"
        yield bus


def wait_for(bus: PythonCanBus, size: int) -> None:
    """Wait until so many bytes are in the port: the kernel brings them there by a thread of its own."""
    deadline = time.monotonic() + PATIENCE_S
    while bus._bus.serialPortOrig.in_waiting < size and time.monotonic() < deadline:  # type: ignore[attr-defined]
        time.sleep(0.001)


def test_bad_lines_are_counted_and_the_good_ones_around_them_arrive(line, bus):
    counted = dict.fromkeys(BAD_LINES, 0)
    for reason, bad in ((reason, bad) for reason, lines in BAD_LINES.items() for bad in lines):
        # A good line may bear the time stamp of the adapter.
        line.write(LINE + bad + LINE * 2 + LINE[:-1] + b"EA5F\r")
        got = collected(bus, 4)
        assert [(frame.frame_id, frame.data, frame.is_fd) for frame in got] == [(0x120, FRAME.data, True)] * 4, bad
        counted[reason] += 1
        assert rejections(bus) == {reason: count for reason, count in counted.items() if count}, bad


def test_a_line_may_arrive_in_two_parts_and_noise_takes_no_more_memory_than_a_line(line, bus):
    for cut in range(1, len(LINE)):
        line.write(LINE[:cut])
        assert bus.receive_all() == [], cut
        line.write(LINE[cut:])
        assert len(collected(bus, 1)) == 1, cut
    assert rejections(bus) == {}
    for _ in range(20):
        line.write(b"A" * 2000)
        wait_for(bus, 2000)
        assert bus.receive_all() == []
        assert len(bus._bus._buffer) <= LINE_LIMIT
    # Adapters answer each frame; a collection that stopped there would fall behind by one answer a period.
    content = b"\r" + LINE + b"z\r" + LINE + b"\r" + LINE + b"Z\r" + LINE
    line.write(content)
    wait_for(bus, len(content))
    assert len(bus.receive_all()) == 4


@pytest.fixture(scope="module")
def looped() -> Iterator[SlcanBus]:
    """What it sends comes back, through pyserial alone: no POSIX port."""
    with SlcanBus("loop://", sleep_after_open=0.0) as bus:
        bus.flush()
        yield bus


@given(message=can_messages())
def test_lines_that_python_can_writes_are_read_back(looped, message):
    looped.send(message)
    got = looped.recv(PATIENCE_S)
    assert got is not None
    message.error_state_indicator = False  # the protocol does not have it
    message.timestamp = got.timestamp
    assert got.equals(message, check_direction=False, check_channel=False)


def test_line_that_went_out_whole_is_no_failure_however_late(line, bus, monkeypatch):
    """The process may lose the processor between the write and the look at the clock."""
    write = os.write

    def write_and_lose_the_processor(fd: int, content: bytes) -> int:
        count = write(fd, content)
        time.sleep(0.02)
        return count

    monkeypatch.setattr(os, "write", write_and_lose_the_processor)
    bus.send(FRAME, timeout_s=0.005)
    monkeypatch.undo()
    assert line.read(b"\r") == LINE


def test_port_that_takes_no_more_is_reported_in_time_and_cuts_one_line_only(line, bus):
    sent = 0
    with pytest.raises(BusError, match=r"0x120 was not sent: the serial port accepted \d+ of 30 bytes in 0\.005 s"):
        while True:
            bus.send(FRAME)
            sent += 1
            assert sent < 10_000
    heard = line.read(LINE, sent)
    bus.send(FRAME, timeout_s=PATIENCE_S)
    heard += line.read(LINE, sent + 1 - heard.count(LINE))
    lines = heard.removesuffix(b"\r").split(b"\r")
    # All that were sent, in whole; at most one that was cut off; and the one that follows.
    assert lines.count(LINE[:-1]) == sent + 1
    assert len(lines) <= sent + 2
    for cut in set(lines) - {LINE[:-1]}:
        assert LINE.startswith(cut)
        assert why_refused(cut) in (Rejection.WRONG_LENGTH, Rejection.GARBAGE)


def test_a_port_that_another_thread_closes_during_a_write_is_an_error_of_the_bus(bus, monkeypatch):
    def closed_meanwhile(fd: int, content: bytes) -> int:
        bus._bus.serialPortOrig.close()
        raise BlockingIOError

    monkeypatch.setattr(os, "write", closed_meanwhile)
    with pytest.raises(BusError, match="was not sent: the serial port failed"):
        bus.send(FRAME)


def test_classic_bus_and_bit_rates_that_the_protocol_does_not_have(line):
    usual = BusConfig(interface="slcan", channel=line.port)
    with PythonCanBus.open(replace(usual, frames="classic")) as classic:
        commands = line.read(b"O\r", 2)
        assert b"S6\r" in commands and b"Y" not in commands
        classic.send(Frame(frame_id=0x121, data=bytes(8), is_fd=False))
        assert line.read(b"\r") == b"t1218" + b"00" * 8 + b"\r"
    assert line.read(b"\r") == b"C\r"
    for config in (replace(usual, nominal_bitrate=400_000), replace(usual, data_bitrate=4_000_000)):
        with refused(BusError, r"CAN bus slcan '.*': Invalid .*bitrate, choose one of"):
            PythonCanBus.open(config)


def test_port_that_vanishes_ends_the_bus_and_closes_without_another_error(line):
    config = BusConfig(interface="slcan", channel=line.port)
    with pytest.raises(BusError, match="CAN bus failed"), PythonCanBus.open(config) as bus:
        os.close(line.fd)
        # The error of the body must come out, not one of closing.
        with pytest.raises(BusError, match="was not sent"):
            bus.send(FRAME)
        collected(bus, 1)
    assert not bus._bus.serialPortOrig.is_open  # type: ignore[attr-defined]
    with pytest.raises(BusError, match="was not sent: the serial port is closed"):
        bus.send(FRAME)
    with pytest.raises(BusError, match="closed"):
        bus.receive_all()
    bus.close()
