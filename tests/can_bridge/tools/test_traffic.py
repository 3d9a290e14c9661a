"""Rates, ages, losses, counts, times and load of traffic whose answer is known, and what a live view lists of it."""

from itertools import accumulate
from typing import Any

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.conversion import to_message
from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.receiver import FrameCheck
from can_bridge.tools.traffic import RATE_OVER, SILENT_AFTER, Summary, Traffic, rows
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE, SPECS, MessageSpec
from contract.config.vehicle import BusConfig, E2eConfig
from tests.examples import examples

E2E = E2eConfig()


def frame(spec: MessageSpec, counter: int, t_ns: int = 0) -> Frame:
    protected = profile_of(spec).protect(bytes(spec.protected), data_id=spec.data_id, counter=counter)
    data = protected + bytes(spec.length - spec.protected)
    return Frame(frame_id=spec.frame_id, data=data, timestamp_ns=t_ns, is_fd=spec.is_fd)


def after(frames: list[Frame]) -> Traffic:
    traffic = Traffic(E2E)
    for one in frames:
        traffic.add(one)
    return traffic


@given(period_ns=st.integers(1, 10**10), count=st.integers(2, 3 * RATE_OVER), begin=st.integers(0, 2 * 10**18))
def test_rate_and_age_of_a_periodic_message(period_ns, count, begin):
    traffic = after([Frame(frame_id=1, data=b"", timestamp_ns=begin + i * period_ns) for i in range(count)])
    last = begin + (count - 1) * period_ns
    # Whole ns in, one division: exact to a rounding or two.
    assert traffic.rate_hz(last) == pytest.approx(1e9 / period_ns, rel=1e-12)
    assert traffic.mean_rate_hz == pytest.approx(1e9 / period_ns, rel=1e-12)
    assert traffic.age_ns(last + 17) == 17
    assert (traffic.count, traffic.first_ns, traffic.last_ns) == (count, begin, last)
    assert traffic.rate_hz(last + int(SILENT_AFTER * period_ns) + 1) == 0.0
    assert len(traffic.recent_ns) <= RATE_OVER + 1


def test_rate_follows_a_change_and_needs_two_times():
    gaps = [10_000_000] * 50 + [50_000_000] * RATE_OVER
    traffic = after([Frame(frame_id=1, data=b"", timestamp_ns=t) for t in accumulate([0, *gaps])])
    assert (traffic.rate_hz(traffic.last_ns), traffic.mean_rate_hz) == pytest.approx((20.0, 70 / 1.5))
    for times in [[5], [5, 5], [9, 3]]:
        traffic = after([Frame(frame_id=1, data=b"", timestamp_ns=t) for t in times])
        assert (traffic.rate_hz(9), traffic.mean_rate_hz, traffic.age_ns(0)) == (0.0, 0.0, 0), times


@examples(60)
@given(spec=st.sampled_from(SPECS), data=st.data())
def test_losses_are_those_that_were_made(spec, data):
    """Fewer than a counter's period in a row: a counter cannot show more."""
    period = profile_of(spec).counter_period
    gaps = data.draw(st.lists(st.integers(0, period - 2), max_size=30))
    counters = accumulate([data.draw(st.integers(0, period - 1)), *(gap + 1 for gap in gaps)])
    traffic = after([frame(spec, counter % period) for counter in counters])
    assert traffic.lost == sum(gaps)
    assert traffic.receiver.count(FrameCheck.ERROR) == 0
    assert traffic.refused == sum(gap + 1 > E2E.max_delta for gap in gaps)


def test_a_classic_frame_for_a_can_fd_message_fails_its_check_and_a_jump_is_lost_and_refused():
    command = frame(JET_COMMAND, 0)
    assert after([Frame(frame_id=command.frame_id, data=command.data, is_fd=False)]).check is FrameCheck.ERROR
    traffic = after([command, command, frame(JET_COMMAND, 2 + E2E.max_delta)])
    assert (traffic.check, traffic.lost, traffic.refused) == (FrameCheck.WRONG_SEQUENCE, 1 + E2E.max_delta, 2)


def summary_of(*traffic: Frame | can.Message, most: int | None = None) -> Summary:
    summary = Summary(config=BusConfig(), most=most)
    for one in traffic:
        summary.add(to_message(one) if isinstance(one, Frame) else one)
    return summary


def test_load_of_known_frames():
    """Identifier 0x555 and data 0x55...: no five equal bits up to the CRC, so stuff bits can only lie there.

    111 bits without stuffing (ISO 11898-1: 44 + 64 and 3 of intermission), at most 3 behind; at 500 kbit/s every ms.
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
