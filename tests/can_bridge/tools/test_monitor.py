"""The model of the live view: rows of known streams."""

from dataclasses import replace

import pytest

from can_bridge.tools.monitor import MOST_MESSAGES, MonitorState, rows
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE
from tests.can_bridge.tools.test_observed_traffic import frame


def state_of(*frames: Frame) -> MonitorState:
    state = MonitorState()
    for one in frames:
        state = state.seen(one)
    return state


def test_rows_of_a_command_with_a_loss():
    state = state_of(*(frame(JET_COMMAND, i, t_ns=i * 20_000_000) for i in (0, 1, 3)))
    listed = rows(state, 100_000_000)
    signals = ["Mode", "Enable", "PressureCounterValid", "NextPeriod", "Flow", "PressureCounter"]
    assert [one.signal for one in listed] == signals
    assert [one.is_first for one in listed] == [True] + 5 * [False]
    flow = listed[4]
    assert (flow.message, flow.frame_id, flow.value, flow.unit) == ("JetCommand", "130", "0", "m2/s")
    # Frames at 0, 20 and 60 ms, looked at 100 ms: two intervals in 60 ms, age 40 ms.
    assert flow.rate_hz == pytest.approx(2 / 0.06)
    assert flow.age_s == pytest.approx(0.04)
    assert (flow.lost, flow.refused, flow.e2e, flow.is_good) == (1, 0, "some lost", True)
    assert (state.lost, state.refused, state.frames) == (1, 0, 3)


def test_a_refused_frame_shows():
    good = frame(JET_COMMAND, 0)
    (first, *_) = rows(state_of(good, replace(good, data=good.data[:-1] + b"\1")), 0)
    assert (first.e2e, first.is_good, first.refused) == ("CRC wrong", False, 1)


def test_unknown_and_unreadable_messages_show_their_bytes():
    state = state_of(
        Frame(frame_id=0x1ABCDEF0, data=b"\xde\xad", is_extended=True, is_fd=False),
        Frame(frame_id=0x7FF, data=b"", is_fd=False),
        Frame(frame_id=0x120, data=b"\1\2"),
    )
    assert [(one.message, one.frame_id, one.signal, one.value) for one in rows(state, 0)] == [
        ("Pressure", "120", "not readable", "01 02"),
        ("unknown", "7FF", "data", "empty"),
        # 29-bit identifiers stand behind the others.
        ("unknown", "1ABCDEF0", "data", "de ad"),
    ]


def test_filter_wants_every_word():
    state = state_of(frame(JET_COMMAND, 0), frame(PRESSURE, 0))
    for words, signals in [
        ("jet FLOW", ["Flow"]),
        ("130 counter", ["PressureCounterValid", "PressureCounter"]),
        ("pressure pressure0", ["Pressure0"]),
        ("nothing", []),
    ]:
        matching = rows(state, 0, matching=words)
        assert [one.signal for one in matching] == signals, words
        assert [one.is_first for one in matching] == [True, False, False][: len(signals)], words


def test_random_identifiers_fill_neither_memory_nor_table():
    known = frame(PRESSURE, 0)
    state = state_of(known)
    for i in range(MOST_MESSAGES + 500):
        state = state.seen(Frame(frame_id=0x1000 + i, data=b"", is_fd=False, is_extended=True))
    state = state.seen(known)
    assert (len(state.messages), state.unlisted) == (MOST_MESSAGES, 501)
    # What is listed is still followed.
    assert state.frames == MOST_MESSAGES + 502
    assert state.messages[False, PRESSURE.frame_id].count == 2
