"""Counts, times and load of traffic that was made up, and what a live view lists of it."""

from typing import Any

import can

from can_bridge.bus.conversion import to_message
from can_bridge.tools.summary import Summary, rows
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE
from contract.config.vehicle import BusConfig
from tests.can_bridge.tools.test_observed_traffic import frame


def summary_of(*traffic: Frame | can.Message, most: int | None = None) -> Summary:
    summary = Summary(config=BusConfig(), most=most)
    for one in traffic:
        summary.add(to_message(one) if isinstance(one, Frame) else one)
    return summary


def test_load_of_known_frames():
    """Identifier 0x555 and data 0x55...: no five equal bits up to the CRC, so stuff bits can only lie there.

    111 bits without stuffing (ISO 11898-1: 44 + 64 and 3 of intermission) and at most 3 in the CRC and its
    neighbourhood, at 500 kbit/s every ms.
    """
    alternating: dict[str, Any] = {"arbitration_id": 0x555, "is_extended_id": False, "data": b"\x55" * 8}
    load = summary_of(*(can.Message(timestamp=i / 1000, **alternating) for i in range(101))).load
    assert load is not None and 111 - 1e-6 <= load * 100 / 101 * 500 <= 114 + 1e-6
    fast, slow = (
        summary_of(*(can.Message(timestamp=t, is_fd=True, bitrate_switch=brs, data=bytes(64)) for t in (0, 1))).load
        for brs in (True, False)
    )
    assert fast is not None and slow is not None
    # 64 bytes and their stuff bits at 500 kbit/s in place of 2 Mbit/s.
    assert 2.5 * fast < slow < 4.0 * fast


def test_times_and_other_frames_of_a_log_that_runs_backwards():
    frames = [can.Message(timestamp=t, data=bytes(8)) for t in (9.0, 1.0, 5.0)]
    frames += [can.Message(timestamp=5.0, **odd) for odd in ({"is_error_frame": True}, {"is_remote_frame": True})]
    frames += [can.Message(timestamp=5.0, data=bytes(9))]
    found = summary_of(*frames)
    assert (found.first_s, found.last_s, found.span_s) == (1.0, 9.0, 8.0)
    assert (found.frames, found.errors.total(), found.remote, found.unsound) == (3, 1, 1, 1)


def test_unknown_and_unreadable_messages_show_their_bytes_behind_all_11_bit_identifiers():
    summary = summary_of(
        Frame(frame_id=0x1ABCDEF0, data=b"\xde\xad", is_extended=True, is_fd=False),
        Frame(frame_id=0x7FF, data=b"", is_fd=False),
        Frame(frame_id=0x7E8, data=b"\0"),
        Frame(frame_id=0x120, data=b"\1\2"),
    )
    assert [(one.name, one.latest.frame_id, *cells) for one, cells in rows(summary)] == [
        ("Pressure", 0x120, ("not readable", "01 02", "")),
        ("UDS answer", 0x7E8, ("data", "00", "")),
        ("", 0x7FF, ("data", "empty", "")),
        ("", 0x1ABCDEF0, ("data", "de ad", "")),
    ]


def test_filter_wants_every_word():
    summary = summary_of(frame(JET_COMMAND, 0), frame(PRESSURE, 0))
    for words, signals in [
        ("jet FLOW", ["Flow"]),
        ("130 counter", ["PressureCounterValid", "PressureCounter"]),
        ("pressure pressure0", ["Pressure0"]),
        ("nothing", []),
    ]:
        assert [cell[0] for _, cells in rows(summary, matching=words) for cell in cells] == signals, words


def test_random_identifiers_fill_neither_memory_nor_table():
    known = frame(PRESSURE, 0)
    others = [Frame(frame_id=0x1000 + i, data=b"", is_fd=False, is_extended=True) for i in range(20)]
    summary = summary_of(known, *others, known, most=10)
    assert (len(summary.messages), summary.unlisted, summary.frames) == (10, 11, 22)
    # What is listed is still followed.
    assert summary.messages["", False, PRESSURE.frame_id].count == 2
