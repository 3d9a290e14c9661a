"""Whatever arrives, the ECU answers, counts, and keeps its promises about the jets."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.e2e.profile5 import check, protect
from can_bridge.e2e.sender import SenderState
from can_bridge.wire.frame import FD_LENGTHS, Frame
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S, PRESSURE
from can_bridge.wire.messages import Mode
from contract.config.tree import Config


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
