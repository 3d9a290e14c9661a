"""Packets as the tables of the standard (ASAM MCD-1 XCP, part 2) have them, written out by hand; for anything in any
state see `tests/proofs/loader_in_c/xcp_tool.py`."""

import struct
import zlib

import numpy as np
import pytest

from can_bridge.calibration.daq import measured_bytes
from can_bridge.calibration.xcp import Command
from can_bridge.calibration.xcp_slave import IDLE_NS, XcpSlave
from can_bridge.flashing.state import Level
from can_bridge.wire.messages import Mode, Reason
from tests.can_bridge.calibration.conftest import REFERENCE, changed
from tests.can_bridge.flashing.store_ecu import KEY

CONNECT = "FF 00"
START, EFFORT = "F6 00 00 00 00 00 00 20", "F6 00 00 00 14 00 00 20"
"""SET_MTA to the first value, and to the sixth."""
ONE = "F0 04 00 00 80 3F"
"""DOWNLOAD of 1.0."""
ERRORS = {
    **{"SYNTAX": "FE 21", "RANGE": "FE 22", "PROTECTED": "FE 23", "DENIED": "FE 24", "LOCKED": "FE 25"},
    **{"NO_PAGE": "FE 26", "NO_MODE": "FE 27", "NO_SEGMENT": "FE 28", "SEQUENCE": "FE 29"},
    **{"ACTIVE": "FE 11", "CONFIG": "FE 2A", "OVERFLOW": "FE 30"},
}


def ask(slave: XcpSlave, *commands: str, now_ns: int = 0) -> str:
    """The answer to the last of some commands."""
    answers = list[bytes]()
    for command in commands:
        answers = slave.command(now_ns, bytes.fromhex(command))
    return " / ".join(answer.hex(" ").upper() for answer in answers)


def talk(slave: XcpSlave, text: str) -> None:
    """Lines of a command and its answer, in hex or by the error's name; `-`: none; `+` joins commands."""
    names = {"CONNECT": CONNECT, "START": START, "EFFORT": EFFORT, "ONE": ONE, "-": "", **ERRORS}
    for line in text.strip().splitlines():
        commands, _, answer = (part.strip() for part in line.partition(">"))
        each = [names.get(command.strip(), command) for command in commands.split("+")]
        assert ask(slave, *each) == names.get(answer, answer), line


def unlock(slave: XcpSlave, *, flip: int = 0) -> str:
    """Fetch the seed, send the key in pieces; the last answer."""
    seed = b""
    for mode in (0, 1):
        (answer,) = slave.command(0, bytes([0xF8, mode, 1]))
        assert answer[:2] == bytes([0xFF, 12 - len(seed)])
        seed += answer[2:]
    key = bytearray(KEY.answer(Level.CALIBRATION, seed))
    key[-1] ^= flip
    assert [ask(slave, f"F7 {16 - at:02X} {key[at : at + 6].hex()}") for at in (0, 6)] == ["FF 01", "FF 01"]
    return ask(slave, f"F7 04 {key[12:].hex()} 00 00")


@pytest.fixture
def unlocked(slave) -> XcpSlave:
    ask(slave, CONNECT)
    assert unlock(slave) == "FF 00"
    return slave


def test_only_a_connected_tool_is_answered_and_what_is_not_announced_is_unknown(slave):
    packets = {code: f"{code:02X} 00 00 00 00 00 00 00" for code in range(0xFF)}
    assert {ask(slave, packet) for packet in ("", *packets.values())} == {""}
    ask(slave, CONNECT)
    for code in packets.keys() - set(Command):
        assert ask(slave, packets[code]) == "FE 20"


def test_what_a_tool_reads(slave):
    first, second = (REFERENCE.pack()[at : at + 7].hex(" ").upper() for at in (0, 7))
    talk(
        slave,
        f"""
        CONNECT > FF 05 80 08 08 00 01 01
        FB > FF 00 00 00 00 00 00 10
        FE > FF
        FD > -
        CONNECT + FD > FF 00 01 00 00 00
        FC > FE 00
        FA 01 > FF 00 00 00 09 00 00 00
        F5 07 > FF {b"stillwa".hex(" ").upper()}
        F5 02 > FF {b"ke".hex(" ").upper()}
        FA 04 > FF 00 00 00 00 00 00 00
        FA 01 + F6 00 00 00 02 00 00 20 + F5 02 > FF 80 3F
        FA 01 + F4 02 00 00 00 00 00 20 + F5 02 > FF 80 3F
        F4 04 00 00 28 00 00 20 > FF 01 00 00 00
        START + F5 07 > FF {first}
        F5 07 > FF {second}
        F4 01 00 00 2C 00 00 20 > DENIED
        F4 01 00 00 FF FF FF 1F > DENIED
        F4 04 00 00 29 00 00 20 > DENIED
        F4 00 00 00 00 00 00 20 > RANGE
        F5 08 > RANGE
        F6 00 00 01 00 00 00 20 > RANGE
        E9 > FF 01 00
        E8 00 00 00 00 > FF 00 00 00 00 00 00 20
        E8 00 00 01 00 > FF 00 00 00 2C 00 00 00
        E8 01 00 00 00 > FF 02 00 00 00 00
        E8 02 00 00 00 > RANGE
        E8 00 01 00 00 > NO_SEGMENT
        E7 00 00 00 > FF 3F 00
        E7 00 00 01 > FF 0F 00
        E7 00 00 02 > NO_PAGE
        """,
    )
    for command in ("FF", "FA", "F8 00", "F6 00 00 00 00 00 00", "F4 04", "F3 00 00 00 28", "E8 00"):
        assert ask(slave, command) == ERRORS["SYNTAX"], command


def test_only_the_right_key_opens_changes_until_the_end_of_its_connection(slave, segment):
    ask(slave, CONNECT, EFFORT)
    for command in (ONE, "EB 83 00 01", "EA 01 00", "E4 00 01 00 00", "F9 01 00 00"):
        assert ask(slave, command) == ERRORS["LOCKED"]
    for flip in (1, 0x80):
        ask(slave, CONNECT)
        assert unlock(slave, flip=flip) == ERRORS["LOCKED"]
        assert ask(slave, EFFORT) == ""
        assert ask(slave, CONNECT, EFFORT, ONE) == ERRORS["LOCKED"]
    for again in (CONNECT, "FE"):
        ask(slave, CONNECT)
        assert unlock(slave) == "FF 00"
        assert ask(slave, again, CONNECT, EFFORT, ONE) == ERRORS["LOCKED"], again
    assert segment.take() is None and slave.to_store(0) is None
    assert unlock(slave) == "FF 00"
    talk(slave, "FD > FF 00 00 00 00 00\nEFFORT + ONE > FF\nF0 04 00 00 00 40 > FF")
    taken = segment.take()
    assert (taken.weights.effort, taken.weights.rate) == (1.0, 2.0)
    # Another connection begins with the working page, and at no address.
    ask(slave, START, "EB 02 00 01", "FE", CONNECT)
    assert ask(slave, "F5 01") == ERRORS["DENIED"]
    unlock(slave)
    talk(slave, "EA 02 00 > FF 00 00 00\nFA 01 + FE + CONNECT + F5 01 > DENIED")


def test_seed_and_key_come_in_order_and_a_key_is_good_for_one_seed(slave):
    key = "F7 10 00 00 00 00 00 00"
    talk(
        slave,
        f"""
        CONNECT + F8 01 01 > SEQUENCE
        {key} > SEQUENCE
        F8 00 04 > RANGE
        F8 02 01 > RANGE
        F8 00 01 + F8 00 04 + F8 01 01 > SEQUENCE
        F8 00 01 + {key} > SEQUENCE
        F8 00 01 + F8 01 01 + F8 01 01 > SEQUENCE
        F8 00 01 + F8 01 01 + F7 10 00 00 00 00 00 > SYNTAX
        F7 0A 00 00 00 00 00 00 > SEQUENCE
        {key} > SEQUENCE
        """,
    )
    assert unlock(slave) == "FF 00"
    talk(slave, f"{key} > SEQUENCE\nF8 00 01 > FF 00\n{key} > SEQUENCE")
    ask(slave, CONNECT, "F8 00 01", "F8 01 01")
    old = KEY.answer(Level.CALIBRATION, (1).to_bytes(12, "big"))
    assert ask(slave, *(f"F7 {16 - at:02X} {old[at : at + 6].hex()}" for at in (0, 6, 12))) == ERRORS["LOCKED"]


def test_a_connection_that_is_left_alone_ends(unlocked, segment):
    assert ask(unlocked, EFFORT, now_ns=IDLE_NS) == "FF"
    for now_ns in (2 * IDLE_NS, IDLE_NS):
        assert ask(unlocked, "FD", now_ns=now_ns) == "FF 00 00 00 00 00"
    assert ask(unlocked, ONE, now_ns=2 * IDLE_NS + 1) == ""
    assert ask(unlocked, "FD", now_ns=2 * IDLE_NS + 1) == ""
    assert segment.take() is None


def test_what_is_written(unlocked, segment):
    talk(
        unlocked,
        """
        EFFORT + F0 04 00 00 80 BF > RANGE
        F0 04 00 00 C0 7F > RANGE
        F0 00 00 > RANGE
        F0 07 00 00 00 00 00 00 > RANGE
        F0 04 00 00 80 > SYNTAX
        F6 00 00 00 2C 00 00 20 + ONE > DENIED
        F6 00 00 00 16 00 00 20 + ONE > RANGE
        """,
    )
    assert segment.take() is None
    raw = struct.pack("<10fI", 1, 2, 3, 4, 5, 6, 7, 8, 0.05, 0.025, 2)
    ask(unlocked, START)
    for begin in range(0, 44, 6):
        piece = raw[begin : begin + 6]
        assert ask(unlocked, f"F0 {len(piece):02X} {piece.hex()}") == "FF"
    assert segment.take().weights.as_tuple() == (1, 2, 3, 4, 5, 6, 7, 8)
    talk(
        unlocked,
        f"""
        START + F3 00 00 00 2C 00 00 00 > FF 09 00 00 {zlib.crc32(raw).to_bytes(4, "little").hex(" ").upper()}
        F5 01 > DENIED
        START + F3 00 00 00 2D 00 00 00 > DENIED
        """,
    )


LISTED = "D6 + D5 00 01 00 + D4 00 00 00 02"
"""One list of two frames."""


def test_a_list_is_allocated_and_written_in_order(slave):
    talk(
        slave,
        f"""
        CONNECT + DA > FF 01 00 00 01 00 00 00
        D9 > FF 01 07 01 00 00 00 00
        D7 00 00 00 > FF 44 01 0E C8 05 00
        F5 07 > FF {b"control".hex(" ").upper()}
        F5 07 > FF {b" period".hex(" ").upper()}
        D7 00 01 00 > RANGE
        D5 00 01 00 > SEQUENCE
        D6 + D4 00 00 00 01 > SEQUENCE
        D5 00 02 00 > OVERFLOW
        D5 00 01 00 > FF
        DA > FF 01 01 00 01 00 00 00
        D3 00 00 00 00 01 > SEQUENCE
        D4 00 01 00 01 > RANGE
        D4 00 00 00 11 > OVERFLOW
        D4 00 00 00 00 > RANGE
        {LISTED} > FF
        D5 00 01 00 > SEQUENCE
        D3 00 00 00 02 01 > RANGE
        D3 00 00 00 00 21 > OVERFLOW
        D3 00 00 00 00 02 > FF
        D3 00 00 00 00 01 > SEQUENCE
        E1 FF 04 00 00 01 00 20 > SEQUENCE
        E2 00 00 00 01 00 > RANGE
        D3 00 00 00 01 01 > FF
        E2 00 00 00 00 02 > RANGE
        E2 00 00 00 00 00 > FF
        E1 00 04 00 00 01 00 20 > RANGE
        E1 FF 08 00 00 01 00 20 > RANGE
        E1 FF 04 01 00 01 00 20 > RANGE
        E1 FF 04 00 00 00 00 20 > DENIED
        E1 FF 04 00 41 01 00 20 > DENIED
        E1 FF 04 00 10 01 00 20 > FF
        E1 FF 04 00 00 01 00 20 > CONFIG
        E1 FF 01 00 14 01 00 20 > FF
        E1 FF 01 00 14 01 00 20 > SEQUENCE
        E0 02 00 00 00 00 01 00 > NO_MODE
        E0 00 00 00 01 00 01 00 > RANGE
        E0 00 00 00 00 00 02 00 > RANGE
        E0 00 00 00 00 00 01 FF > FF
        DE 03 00 00 > NO_MODE
        DE 01 01 00 > RANGE
        DD 03 > NO_MODE
        DE 02 00 00 > FF 00
        DF 00 00 00 > FF 01 00 00 00 00 01 00
        DD 01 > FF
        DF 00 00 00 > FF 40 00 00 00 00 01 00
        FD > FF 40 01 00 00 00
        E2 00 00 00 00 00 > ACTIVE
        E1 FF 04 00 00 01 00 20 > ACTIVE
        E0 00 00 00 00 00 01 00 > ACTIVE
        DE 02 00 00 + DD 02 + FD > FF 00 01 00 00 00
        DE 01 00 00 + CONNECT + FD > FF 00 01 00 00 00
        D6 + D5 00 01 00 + DE 01 00 00 > CONFIG
        """,
    )


def test_each_period_is_sent_whole_or_not_at_all(slave):
    def period(number: int) -> bytes:
        measured = measured_bytes(
            np.array([0.5, -1.0, number, 2.0]), 0.05, mode=Mode.CONTROL, reason=Reason.NONE, gated=16,
            calibration=REFERENCE,
        )  # fmt: skip
        slave.daq.sample(measured)
        slave.daq.look()
        return measured

    ask(slave, CONNECT)
    first = period(1)
    # Without a list it is read.
    assert ask(slave, "F4 07 00 00 0C 01 00 20") == b"\xff".hex().upper() + " " + first[12:19].hex(" ").upper()
    assert ask(slave, "F4 01 00 00 44 01 00 20") == ERRORS["DENIED"]
    assert len(first) == 0x44 and first[:8] == struct.pack("<2f", 0.5, -1.0)
    # The third sensor's pressure; the mode and the weight of the mean drag.
    ask(slave, *f"{LISTED} + D3 00 00 00 00 01 + D3 00 00 00 01 02 + E2 00 00 00 00 00".split(" + "))
    ask(slave, "E1 FF 04 00 08 01 00 20", "E2 00 00 00 01 00", "E1 FF 01 00 14 01 00 20", "E1 FF 04 00 18 01 00 20")
    assert ask(slave, "DE 01 00 00") == "FF 00" and slave.daq.packets(8) == []
    second = [b"\0" + struct.pack("<f", 2), b"\1" + bytes([Mode.CONTROL]) + struct.pack("<f", 1.0)]
    period(2)
    assert slave.daq.packets(1) == second[:1]
    period(3)
    assert slave.daq.packets(8) == second[1:] and slave.daq.packets(8) == []
    period(4)
    assert slave.daq.packets(8) == [b"\0" + struct.pack("<f", 4), second[1]]
    # A tool that only listens is not left alone, but locked.
    assert slave.to_store(2 * IDLE_NS) is None and ask(slave, "FD", now_ns=2 * IDLE_NS) == "FF 40 01 00 00 00"
    ask(slave, "DD 00", now_ns=2 * IDLE_NS)
    period(5)
    assert slave.daq.packets(8) == [] and ask(slave, "FD", now_ns=4 * IDLE_NS) == ""


def test_pages(unlocked, segment):
    talk(unlocked, "EFFORT + ONE + EA 01 00 > FF 00 00 00\nEB 01 00 01 > FF")
    assert (segment.take(), segment.in_force) == (None, REFERENCE)
    talk(
        unlocked,
        """
        EA 01 00 > FF 00 00 01
        EA 02 00 > FF 00 00 00
        EB 02 00 01 > FF
        F4 04 00 00 14 00 00 20 > FF 00 00 00 00
        EFFORT + ONE > PROTECTED
        EB 83 FF 00 > FF
        F4 04 00 00 14 00 00 20 > FF 00 00 80 3F
        EB 03 00 02 > NO_PAGE
        EB 03 01 00 > NO_SEGMENT
        EB 80 00 00 > NO_MODE
        EA 03 00 > NO_MODE
        EA 01 01 > NO_SEGMENT
        E4 00 02 00 00 > NO_PAGE
        E4 00 01 01 00 > NO_SEGMENT
        E4 00 00 00 01 > PROTECTED
        E4 00 00 00 00 > FF
        """,
    )
    assert segment.in_force != segment.reference
    assert ask(unlocked, "E4 00 01 00 00") == "FF"
    assert segment.take() is None


def test_the_values_of_the_moment_are_stored_or_dropped_with_the_connection(unlocked, segment):
    slave = unlocked
    talk(slave, "F9 02 00 00 > RANGE\nF9 01 00 00 > FF\nFD > FF 01 00 00 00 00")
    assert (slave.to_store(0), slave.stored()) == (segment.in_force, [b"\xfd\x03"])
    talk(slave, "FD > FF 00 00 00 00 00\nF9 01 00 00 > FF")
    slave.not_stored()
    talk(slave, "FD > FF 00 00 00 00 00")
    for ends, now_ns in (("FE", 0), (CONNECT, 0), ("", IDLE_NS + 1)):
        ask(slave, CONNECT)
        unlock(slave)
        ask(slave, "F9 01 00 00")
        before = segment.in_force
        segment.set(changed(lift=before.weights.lift + 1.0))
        assert slave.to_store(0) == before, ends
        ask(slave, ends)
        assert slave.to_store(now_ns) is None, ends
    assert slave.stored() == []
