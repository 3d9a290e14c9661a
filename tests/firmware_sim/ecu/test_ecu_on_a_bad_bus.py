"""Whatever arrives, the ECU answers, counts, and keeps its promises about the jets."""

from dataclasses import replace

import pytest

from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode, Reason
from tests.each import each


def corrupted(frame: Frame, bit: int) -> Frame:
    data = bytearray(frame.data)
    data[bit // 8] ^= 1 << bit % 8
    return replace(frame, data=bytes(data))


def test_a_repeated_frame_is_a_miss_and_no_crc_error(bench):
    bench.into_control()
    frame = bench.pressure()
    assert bench.step(frame).mode is Mode.CONTROL
    assert bench.step(frame).mode is Mode.HOLD
    assert (bench.status.crc_errors, bench.ecu.frames_rejected) == (0, 1)
    # The same again beside a new one does no harm.
    assert bench.step(frame, bench.pressure()).mode is Mode.CONTROL


def test_the_newest_of_several_frames_counts(bench):
    bench.into_control()
    frames = [bench.pressure((value,) * 4) for value in (0.2, 0.5, 0.8)]
    assert bench.step(*frames).mode is Mode.CONTROL
    assert bench.controller.calls[-1][0][-1, 0] == pytest.approx(0.8, abs=1e-3)


def run_pattern(bench, pattern: str, times: int) -> str:
    """The initials of the modes after each period: G a good frame, c a corrupted one, x none, + two in one period."""
    found = ""
    for period in (pattern.split() if " " in pattern else list(pattern)) * times:
        frames = [
            corrupted(bench.pressure(), 77) if kind == "c" else bench.pressure() for kind in period if kind != "x"
        ]
        found += bench.step(*frames).mode.name[0]
    return found


@each(
    "pattern, expected, reason",
    [
        ("xxxx", "HDDF", Reason.STREAM_LOST),
        # The third wrong CRC among five ends the trust in the stream, whatever good frames came beside.
        ("cccc", "HDFF", Reason.STREAM_INVALID),
        ("cGcGc", "HCHCF", Reason.STREAM_INVALID),
        ("cG cG cG", "CCF", Reason.STREAM_INVALID),
        ("Gc Gc Gc", "CCF", Reason.STREAM_INVALID),
        ("ccG Gcc cGc", "CCF", Reason.STREAM_INVALID),
        ("cccG cccG cccG cccG", "CCFF", Reason.STREAM_INVALID),
        ("xcxcx", "HDDFF", Reason.STREAM_LOST),
        ("GccxGccx", "CHDDCFFF", Reason.STREAM_INVALID),
    ],
)
def test_lost_frames_hold_and_decay_and_a_stream_not_to_be_trusted_shuts_at_once(bench_of, pattern, expected, reason):
    bench = bench_of()
    bench.into_control()
    bench.good(5)
    assert run_pattern(bench, pattern, 1) == expected
    assert bench.status.reason is reason


@each("one, other", [("cG", "Gc"), ("ccG", "Gcc"), ("cGG", "GGc"), ("cccG", "Gccc")])
def test_the_order_of_frames_within_a_period_decides_nothing(bench_of, one, other):
    found = []
    for pattern in (one, other):
        bench = bench_of()
        bench.into_control()
        found.append(run_pattern(bench, f"{pattern} G", 20))
    assert found[0] == found[1]
