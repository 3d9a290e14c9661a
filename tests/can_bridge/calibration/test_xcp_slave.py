"""Packets as the tables of the standard (ASAM MCD-1 XCP, part 2) have them, written out by hand."""

import struct
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.calibration.segment import Segment
from can_bridge.calibration.xcp import Command
from can_bridge.calibration.xcp_slave import IDLE_NS, XcpSlave
from can_bridge.flashing.access_level import Level
from tests.can_bridge.calibration.conftest import LIMITS, REFERENCE, CmacAccess
from tests.examples import examples

CONNECT = "FF 00"
EFFORT = "F6 00 00 00 14 00 00 20"
"""SET_MTA to the sixth value."""
ONE = "F0 04 00 00 80 3F"
"""DOWNLOAD of 1.0."""
SYNTAX, RANGE, PROTECTED, DENIED, LOCKED = "FE 21", "FE 22", "FE 23", "FE 24", "FE 25"
NO_PAGE, NO_MODE, NO_SEGMENT, SEQUENCE = "FE 26", "FE 27", "FE 28", "FE 29"


def ask(slave: XcpSlave, *commands: str, now_ns: int = 0) -> str:
    """The answer to the last of some commands."""
    answers = list[bytes]()
    for command in commands:
        answers = slave.command(now_ns, bytes.fromhex(command))
    return " / ".join(answer.hex(" ").upper() for answer in answers)


def unlock(slave: XcpSlave, access: CmacAccess, *, flip: int = 0) -> str:
    """Fetch the seed, send the key in pieces; the last answer."""
    seed, left = b"", 12
    for mode in (0, 1):
        (answer,) = slave.command(0, bytes([0xF8, mode, 1]))
        assert answer[:2] == bytes([0xFF, left])
        seed += answer[2:]
        left = 12 - len(seed)
    key = bytearray(access.answer(Level.CALIBRATION, seed))
    key[-1] ^= flip
    assert slave.command(0, bytes([0xF7, 16]) + key[:6]) == [bytes.fromhex("FF 01")]
    assert slave.command(0, bytes([0xF7, 10]) + key[6:12]) == [bytes.fromhex("FF 01")]
    return ask(slave, f"F7 04 {key[12:].hex()} 00 00")


@pytest.fixture
def unlocked(slave, access) -> XcpSlave:
    ask(slave, CONNECT)
    assert unlock(slave, access) == "FF 00"
    return slave


def test_connect_lists_what_there_is(slave):
    assert ask(slave, CONNECT) == "FF 01 80 08 08 00 01 01"
    assert ask(slave, "FB") == "FF 00 00 00 00 00 00 10"
    assert slave.is_connected


def test_only_a_connected_tool_is_answered(slave):
    assert ask(slave, "") == ""
    for code in range(0xFF):
        assert ask(slave, f"{code:02X} 00 00 00 00 00 00 00") == ""


def test_disconnect_status_and_synch(slave):
    assert ask(slave, CONNECT, "FE") == "FF"
    assert ask(slave, "FD") == ""
    assert ask(slave, CONNECT, "FD") == "FF 00 01 00 00 00"
    assert ask(slave, "FC") == "FE 00"


def test_what_is_not_announced_is_unknown(slave):
    ask(slave, CONNECT)
    for code in set(range(0xFF)) - set(Command):
        assert ask(slave, f"{code:02X} 00 00 00 00 00 00 00") == "FE 20"


def test_the_name_of_the_a2l_file(slave):
    assert ask(slave, CONNECT, "FA 01") == "FF 00 00 00 09 00 00 00"
    assert ask(slave, "F5 07") == "FF " + b"stillwa".hex(" ").upper()
    assert ask(slave, "F5 02") == "FF " + b"ke".hex(" ").upper()
    assert ask(slave, "FA 04") == "FF 00 00 00 00 00 00 00"


def test_after_the_name_memory_is_read_again(slave):
    for command in ("F6 00 00 00 02 00 00 20", "F4 02 00 00 00 00 00 20"):
        assert ask(slave, CONNECT, "FA 01", command, "F5 02") == "FF 80 3F", command


def test_a_new_connection_begins_anew(unlocked, access):
    ask(unlocked, "F6 00 00 00 00 00 00 20", "EB 02 00 01", "FE", CONNECT)
    assert ask(unlocked, "F5 01") == DENIED
    unlock(unlocked, access)
    assert ask(unlocked, "EA 02 00") == "FF 00 00 00"
    ask(unlocked, "FA 01", "FE", CONNECT)
    assert ask(unlocked, "F5 01") == DENIED


def test_memory_is_read_by_address(slave):
    raw = REFERENCE.pack()
    assert ask(slave, CONNECT, "F4 04 00 00 24 00 00 20") == "FF 01 00 00 00"
    assert ask(slave, "F6 00 00 00 00 00 00 20", "F5 07") == "FF " + raw[:7].hex(" ").upper()
    assert ask(slave, "F5 07") == "FF " + raw[7:14].hex(" ").upper()
    assert ask(slave, "F4 01 00 00 28 00 00 20") == DENIED
    assert ask(slave, "F4 01 00 00 FF FF FF 1F") == DENIED
    assert ask(slave, "F4 04 00 00 25 00 00 20") == DENIED
    assert ask(slave, "F4 00 00 00 00 00 00 20") == RANGE
    assert ask(slave, "F5 08") == RANGE
    assert ask(slave, "F6 00 00 01 00 00 00 20") == RANGE


def test_a_locked_slave_refuses_changes(slave, segment):
    ask(slave, CONNECT, EFFORT)
    for command in (ONE, "EB 83 00 01", "EA 01 00", "E4 00 01 00 00", "F9 01 00 00"):
        assert ask(slave, command) == LOCKED
    assert not segment.is_pending
    assert not slave.wants_store


def test_a_value_is_written_with_the_right_key(unlocked, segment):
    assert ask(unlocked, "FD") == "FF 00 00 00 00 00"
    assert ask(unlocked, EFFORT, ONE) == "FF"
    assert segment.take().weights.effort == 1.0
    assert ask(unlocked, "F0 04 00 00 00 40") == "FF"
    assert segment.take().weights.rate == 2.0


def test_a_wrong_key_ends_the_connection(slave, access, segment):
    for flip in (1, 0x80):
        ask(slave, CONNECT)
        assert unlock(slave, access, flip=flip) == LOCKED
        assert ask(slave, EFFORT) == ""
        assert ask(slave, CONNECT, EFFORT, ONE) == LOCKED
        assert not segment.is_pending


def test_a_key_is_good_for_one_seed(slave, access):
    ask(slave, CONNECT)
    assert unlock(slave, access) == "FF 00"
    assert ask(slave, "F7 10 00 00 00 00 00 00") == SEQUENCE
    assert ask(slave, "F8 00 01") == "FF 00"
    assert ask(slave, "F7 10 00 00 00 00 00 00") == SEQUENCE
    ask(slave, CONNECT)
    old = access.answer(Level.CALIBRATION, bytes([1] * 12))
    ask(slave, "F8 00 01", "F8 01 01")
    pieces = [bytes([0xF7, 16, *old[:6]]), bytes([0xF7, 10, *old[6:12]]), bytes([0xF7, 4, *old[12:]])]
    assert ask(slave, *(piece.hex() for piece in pieces)) == LOCKED


def test_seed_and_key_come_in_order(slave):
    ask(slave, CONNECT)
    assert ask(slave, "F8 01 01") == SEQUENCE
    assert ask(slave, "F7 10 00 00 00 00 00 00") == SEQUENCE
    assert ask(slave, "F8 00 04") == RANGE
    assert ask(slave, "F8 02 01") == RANGE
    assert ask(slave, "F8 00 01", "F8 00 04", "F8 01 01") == SEQUENCE
    assert ask(slave, "F8 00 01", "F7 10 00 00 00 00 00 00") == SEQUENCE
    assert ask(slave, "F8 00 01", "F8 01 01", "F8 01 01") == SEQUENCE
    ask(slave, "F8 00 01", "F8 01 01")
    assert ask(slave, "F7 10 00 00 00 00 00") == SYNTAX
    assert ask(slave, "F7 0A 00 00 00 00 00 00") == SEQUENCE
    assert ask(slave, "F7 10 00 00 00 00 00 00") == SEQUENCE


def test_the_end_of_a_connection_locks(slave, access):
    for again in (CONNECT, "FE"):
        ask(slave, CONNECT)
        assert unlock(slave, access) == "FF 00"
        assert ask(slave, again, CONNECT, EFFORT, ONE) == LOCKED, again


def test_a_connection_that_is_left_alone_ends(unlocked, segment):
    assert ask(unlocked, EFFORT, now_ns=IDLE_NS // 2) == "FF"
    assert ask(unlocked, EFFORT, now_ns=IDLE_NS) == "FF"
    assert ask(unlocked, "FD", now_ns=2 * IDLE_NS) == "FF 00 00 00 00 00"
    assert ask(unlocked, "FD", now_ns=IDLE_NS) == "FF 00 00 00 00 00"
    assert ask(unlocked, ONE, now_ns=2 * IDLE_NS + 1) == ""
    assert not unlocked.is_connected
    assert not segment.is_pending


def test_values_out_of_limits_are_refused(unlocked, segment):
    assert ask(unlocked, EFFORT, "F0 04 00 00 80 BF") == RANGE
    assert ask(unlocked, "F0 04 00 00 C0 7F") == RANGE
    assert ask(unlocked, "F0 00 00") == RANGE
    assert ask(unlocked, "F0 07 00 00 00 00 00 00") == RANGE
    assert ask(unlocked, "F0 04 00 00 80") == SYNTAX
    assert ask(unlocked, "F6 00 00 00 28 00 00 20", ONE) == DENIED
    assert ask(unlocked, "F6 00 00 00 16 00 00 20", ONE) == RANGE
    assert not segment.is_pending
    assert ask(unlocked, EFFORT, ONE) == "FF"


def test_the_whole_segment_in_pieces_of_six(unlocked, segment):
    raw = struct.pack("<9fI", 1, 2, 3, 4, 5, 6, 7, 0.05, 0.025, 2)
    ask(unlocked, "F6 00 00 00 00 00 00 20")
    for begin in range(0, 40, 6):
        piece = raw[begin : begin + 6]
        assert ask(unlocked, f"F0 {len(piece):02X} {piece.hex()}") == "FF"
    assert segment.take().weights.as_tuple() == (1, 2, 3, 4, 5, 6, 7)
    assert ask(unlocked, "F6 00 00 00 00 00 00 20", "F3 00 00 00 28 00 00 00") == (
        "FF 09 00 00 " + zlib.crc32(raw).to_bytes(4, "little").hex(" ").upper()
    )
    assert ask(unlocked, "F5 01") == DENIED
    assert ask(unlocked, "F6 00 00 00 00 00 00 20", "F3 00 00 00 29 00 00 00") == DENIED


def test_pages(unlocked, segment):
    ask(unlocked, EFFORT, ONE)
    assert ask(unlocked, "EA 01 00") == "FF 00 00 00"
    assert ask(unlocked, "EB 01 00 01") == "FF"
    assert segment.take() is None
    assert segment.in_force == REFERENCE
    assert ask(unlocked, "EA 01 00") == "FF 00 00 01"
    assert ask(unlocked, "EA 02 00") == "FF 00 00 00"
    assert ask(unlocked, "EB 02 00 01") == "FF"
    assert ask(unlocked, "F4 04 00 00 14 00 00 20") == "FF 00 00 00 00"
    assert ask(unlocked, EFFORT, ONE) == PROTECTED
    assert ask(unlocked, "EB 83 FF 00") == "FF"
    assert ask(unlocked, "F4 04 00 00 14 00 00 20") == "FF 00 00 80 3F"
    assert segment.take().weights.effort == 1.0


def test_copying_the_reference_reverts(unlocked, segment):
    ask(unlocked, EFFORT, ONE)
    assert ask(unlocked, "E4 00 00 00 00") == "FF"
    assert segment.is_pending
    assert ask(unlocked, "E4 00 01 00 00") == "FF"
    assert not segment.is_pending
    assert ask(unlocked, "E4 00 00 00 01") == PROTECTED


def test_pages_and_segments_that_are_not_there(unlocked):
    assert ask(unlocked, "EB 03 00 02") == NO_PAGE
    assert ask(unlocked, "EB 03 01 00") == NO_SEGMENT
    assert ask(unlocked, "EB 80 00 00") == NO_MODE
    assert ask(unlocked, "EA 03 00") == NO_MODE
    assert ask(unlocked, "EA 01 01") == NO_SEGMENT
    assert ask(unlocked, "E4 00 02 00 00") == NO_PAGE
    assert ask(unlocked, "E4 00 01 01 00") == NO_SEGMENT


def test_what_a_tool_asks_about_segments(slave):
    assert ask(slave, CONNECT, "E9") == "FF 01 00"
    assert ask(slave, "E8 00 00 00 00") == "FF 00 00 00 00 00 00 20"
    assert ask(slave, "E8 00 00 01 00") == "FF 00 00 00 28 00 00 00"
    assert ask(slave, "E8 01 00 00 00") == "FF 02 00 00 00 00"
    assert ask(slave, "E8 02 00 00 00") == RANGE
    assert ask(slave, "E8 00 01 00 00") == NO_SEGMENT
    assert ask(slave, "E7 00 00 00") == "FF 3F 00"
    assert ask(slave, "E7 00 00 01") == "FF 0F 00"
    assert ask(slave, "E7 00 00 02") == NO_PAGE


def test_storing_is_asked_for_and_reported(unlocked):
    assert ask(unlocked, "F9 02 00 00") == RANGE
    assert ask(unlocked, "F9 01 00 00") == "FF"
    assert unlocked.wants_store
    assert ask(unlocked, "FD") == "FF 01 00 00 00 00"
    assert unlocked.stored() == [b"\xfd\x03"]
    assert ask(unlocked, "FD") == "FF 00 00 00 00 00"
    ask(unlocked, "F9 01 00 00", "FE")
    assert unlocked.stored() == []


def test_storing_that_failed_is_over_without_an_event(unlocked):
    ask(unlocked, "F9 01 00 00")
    unlocked.not_stored()
    assert not unlocked.wants_store
    assert ask(unlocked, "FD") == "FF 00 00 00 00 00"


def test_too_short_a_command_is_refused(unlocked):
    for command in ("FF", "FA", "F8 00", "F6 00 00 00 00 00 00", "F4 04", "F3 00 00 00 28", "E8 00"):
        assert ask(unlocked, command) == SYNTAX, command


@examples(300)
@given(
    unlocks=st.booleans(),
    packets=st.lists(
        st.binary(max_size=64)
        | st.builds(lambda code, rest: bytes([code]) + rest, st.sampled_from(list(Command)), st.binary(max_size=7)),
        max_size=40,
    ),
)
def test_whatever_comes_over_the_wire_nothing_is_raised_and_the_limits_hold(unlocks, packets):
    segment = Segment(REFERENCE, LIMITS)
    access = CmacAccess()
    slave = XcpSlave(segment, access, lambda length: b"\x07" * length)
    ask(slave, CONNECT)
    if unlocks:
        unlock(slave, access)
    for packet in packets:
        answers = slave.command(0, packet)
        assert len(answers) <= 1
        assert all(0 < len(answer) <= 8 and answer[0] in (0xFF, 0xFE) for answer in answers)
        LIMITS.check(segment.in_force)
        if not unlocks:
            assert segment.in_force == REFERENCE
