"""Whatever arrives, the ECU answers, counts, and keeps its promises about the jets."""

import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.e2e.profile5 import check, protect
from can_bridge.e2e.sender import SenderState
from can_bridge.wire.frame import FD_LENGTHS, Frame
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S, PRESSURE
from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import Config

WINDOW = 4


def corrupted(frame: Frame, bit: int) -> Frame:
    data = bytearray(frame.data)
    data[bit // 8] ^= 1 << bit % 8
    return replace(frame, data=bytes(data))


@pytest.mark.parametrize("bit", [0, 20, 24, 28, 40, 127])
def test_a_corrupted_frame_is_a_counted_miss(bench, bit):
    full = bench.into_control().flow_m2_per_s
    command = bench.step(corrupted(bench.pressure(), bit))
    assert (command.mode, command.flow_m2_per_s) == (Mode.HOLD, full)
    assert (bench.status.crc_errors, bench.ecu.frames_rejected) == (1, 1)
    assert bench.step(bench.pressure()).mode is Mode.CONTROL


def test_a_repeated_frame_is_a_miss_and_no_crc_error(bench):
    bench.into_control()
    frame = bench.pressure()
    assert bench.step(frame).mode is Mode.CONTROL
    assert bench.step(frame).mode is Mode.HOLD
    assert (bench.status.crc_errors, bench.ecu.frames_rejected) == (0, 1)
    # The same again beside a new one does no harm.
    assert bench.step(frame, bench.pressure()).mode is Mode.CONTROL


def test_a_jump_of_the_counter_is_rejected_once(bench):
    bench.into_control()
    bench.sender.state = SenderState(counter=bench.sender.state.counter + 100)
    assert bench.step(bench.pressure()).mode is Mode.HOLD
    assert bench.ecu.frames_rejected == 1
    assert bench.step(bench.pressure()).mode is Mode.CONTROL


def test_the_newest_of_several_frames_counts(bench):
    bench.into_control()
    frames = [bench.pressure((value,) * 4) for value in (0.2, 0.5, 0.8)]
    assert bench.step(*frames).mode is Mode.CONTROL
    assert bench.controller.calls[-1][0][-1, 0] == pytest.approx(0.8, abs=1e-3)


def test_another_message_under_the_pressures_identifier_is_rejected(bench):
    bench.into_control()
    # Sound in itself, but protected with another data ID.
    data = protect(bytes(PRESSURE.length), data_id=0x5702, counter=bench.sender.state.counter)
    assert bench.step(Frame(frame_id=PRESSURE.frame_id, data=data)).mode is Mode.HOLD
    assert bench.status.crc_errors == 1


def test_a_short_frame_is_rejected(bench):
    bench.into_control()
    data = protect(bytes(8), data_id=PRESSURE.data_id, counter=bench.sender.state.counter)
    assert bench.step(Frame(frame_id=PRESSURE.frame_id, data=data)).mode is Mode.HOLD
    assert bench.status.crc_errors == 1


def run_pattern(bench, pattern: str, times: int) -> str:
    """The initials of the modes after each period: G a good frame, c a corrupted one, x none, + two in one period."""
    found = ""
    for period in (pattern.split() if " " in pattern else list(pattern)) * times:
        frames = [
            corrupted(bench.pressure(), 77) if kind == "c" else bench.pressure() for kind in period if kind != "x"
        ]
        found += bench.step(*frames).mode.name[0]
    return found


@pytest.mark.parametrize(
    ("pattern", "expected", "reason"),
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
def test_lost_frames_hold_and_decay_and_a_stream_not_to_be_trusted_shuts_at_once(bench, pattern, expected, reason):
    bench.into_control()
    bench.good(5)
    assert run_pattern(bench, pattern, 1) == expected
    assert bench.status.reason is reason


@pytest.mark.parametrize(("one", "other"), [("cG", "Gc"), ("ccG", "Gcc"), ("cGG", "GGc"), ("cccG", "Gccc")])
def test_the_order_of_frames_within_a_period_decides_nothing(bench_of, one, other):
    found = []
    for pattern in (one, other):
        bench = bench_of()
        bench.into_control()
        found.append(run_pattern(bench, f"{pattern} G", 20))
    assert found[0] == found[1]


@pytest.mark.parametrize(
    ("pattern", "latches"),
    [("Gxxx", True), ("Gx", True), ("Gc", True), ("Gccx", True), ("GGx", False), ("GGGx", False), ("GGGc", False)],
)
def test_a_bus_that_loses_half_of_the_pressures_is_not_driven_on_for_ever(bench, pattern, latches):
    bench.into_control()
    assert (run_pattern(bench, pattern, 40)[-1] == "F") == latches


def test_a_quarter_of_the_pressures_lost_at_random_is_borne(bench_of):
    """A minute, in which no more than three are lost in a row."""
    bench, rng, in_a_row = bench_of(), random.Random(1), 0
    bench.into_control()
    for _ in range(3000):
        in_a_row = in_a_row + 1 if in_a_row < 3 and rng.random() < 0.25 else 0
        mode = bench.step(*([] if in_a_row else [bench.pressure()])).mode
        assert mode is not Mode.FAULT


@pytest.mark.parametrize("reset_in", ["x" * 8, "G"])
def test_an_ecu_reset_under_a_standing_request_stays_off(bench_of, reset_in):
    """In control, or with a fault latched, which power-on forgets: the request is of the time before."""
    bench = bench_of()
    bench.into_control()
    before = run_pattern(bench, reset_in, 1)[-1]
    assert before == ("F" if "x" in reset_in else "C")
    bench.ecu.restore(bench_of().ecu.state)
    assert {command.mode for command in bench.good(100)} == {Mode.OFF}
    assert bench.good(1, enable=False)[0].mode is Mode.OFF
    assert bench.good(1)[0].mode is Mode.CONTROL


def test_the_request_may_rise_with_the_second_frame_of_all(bench):
    """The first one, from a stream not yet trusted, may withdraw the request and never make one."""
    assert [command.mode for command in bench.good(WINDOW + 1)][1:] == [Mode.WARMUP] * 3 + [Mode.CONTROL]
    bench.into_control()
    jumped = SenderState(counter=(bench.sender.state.counter + 100) % 256)
    bench.sender.state = jumped
    assert bench.step(bench.pressure(enable=False)).mode is Mode.HOLD  # out of sequence: not believed at all
    assert bench.good(1, enable=False)[0].mode is Mode.OFF


GARBAGE = st.builds(
    lambda frame_id, payload, length, time: Frame(
        frame_id=frame_id, data=payload.ljust(64, b"\0")[:length], timestamp_ns=time
    ),
    st.sampled_from([PRESSURE.frame_id, 0x130, 0x140, 0x000, 0x7FF]),
    st.binary(max_size=64),
    st.sampled_from(FD_LENGTHS),
    st.integers(0, 10**15),
).filter(lambda frame: not check(frame.data, data_id=PRESSURE.data_id))  # one in 65536 would pass


@given(st.lists(st.lists(GARBAGE, max_size=4), min_size=1, max_size=12))
def test_random_bytes_never_raise_and_never_open_the_jets(bench_of, periods):
    bench = bench_of()
    for number, frames in enumerate(periods):
        command = bench.step(*frames)
        assert not command.enable
        assert command.flow_m2_per_s == 0.0
        assert bench.status.missed == number + 1
    heard = sum(frame.frame_id == PRESSURE.frame_id for frames in periods for frame in frames)
    assert bench.ecu.frames_rejected == bench.status.crc_errors == heard


PLANS = st.one_of(st.floats(-0.2, 0.2), st.sampled_from([float("nan"), float("inf"), -float("inf")]))
EVENTS = st.lists(st.tuples(st.sampled_from("GGGGGGgxciRS"), PLANS), max_size=40)


@given(EVENTS)
def test_whatever_happens_the_jets_keep_to_the_rules(bench_of, events):
    """G/g good with and without request, x none, c corrupted, i invalid sensor, R repeated, S a skipped period."""
    bench = bench_of()
    config = Config()
    scale = config.operating_point.flow_rate_scale
    limit, step = config.flow.action_limit * scale, config.ecu.command_step * scale
    bench.good(6)
    previous = bench.good(1)[0]
    latest = bench.pressure()
    for event, planned in events:
        bench.controller.plan = lambda i, planned=planned: planned
        frame = latest if event == "R" else bench.pressure(enable=event != "g", valid=(event != "i",) * 4)
        if event == "c":
            frame = corrupted(frame, 77)
        if event == "S":
            bench.now_ns += config.period_ns
        command = bench.step(*([] if event == "x" else [frame]))
        latest = frame
        flow = command.flow_m2_per_s
        assert abs(flow) <= limit + 1e-12
        if command.mode in (Mode.OFF, Mode.WARMUP, Mode.FAULT):
            assert (command.enable, flow) == (False, 0.0)
        elif not command.enable:
            assert flow == 0.0
        elif command.mode is Mode.CONTROL:
            # Rounding to the wire may add half a step of it.
            assert abs(flow - previous.flow_m2_per_s) <= step + FLOW_RESOLUTION_M2_PER_S
        elif command.mode is Mode.HOLD:
            assert flow == previous.flow_m2_per_s
        else:
            assert flow == pytest.approx(0.5 * previous.flow_m2_per_s, abs=FLOW_RESOLUTION_M2_PER_S)
        previous = command
