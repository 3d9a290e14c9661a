"""Frames that are old, lost, damaged or repeated, and a CAN controller with errors: what the ECU makes of each.

That its jets obey it whatever comes is judged in `tests/proofs/ecu`; here are the exact limits and reasons.
"""

from dataclasses import replace
from itertools import product

import pytest

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.command_gate import Intervention
from can_bridge.wire import codec
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode, Reason
from tests.each import each

MS = 1_000_000


def controlling(bench):
    """Late enough for frames that are older than their bench."""
    bench.now_ns = 10**10
    bench.into_control()
    return bench


def aged(bench, age_ms: float, *, in_queue: bool, **message) -> Frame:
    """A frame whose pressures are so old: by its own word, or because it waited in a queue."""
    age_ns = round(age_ms * MS)
    frame = bench.pressure(age_ns=0 if in_queue else age_ns, **message)
    return replace(frame, timestamp_ns=bench.now_ns - age_ns) if in_queue else frame


@each("in_queue, row", product([True, False], [(0.0, True), (20.0, True), (30.0, True), (30.01, False), (60.0, False)]))
def test_pressures_are_planned_on_for_a_period_and_a_half(bench_of, in_queue, row):
    bench, (age_ms, usable) = controlling(bench_of()), row
    calls, missed = len(bench.controller.calls), bench.status.missed
    command = bench.step(aged(bench, age_ms, in_queue=in_queue))
    assert (command.mode, command.enable) == (Mode.CONTROL if usable else Mode.HOLD, True)
    assert bench.status.reason is (Reason.NONE if usable else Reason.STALE)
    assert len(bench.controller.calls) - calls == usable
    assert bench.status.missed - missed == (not usable)


def test_pressures_of_the_future_are_stale_and_a_stale_request_is_a_request_all_the_same(bench_of):
    bench = controlling(bench_of())
    command = bench.step(replace(bench.pressure(), timestamp_ns=bench.now_ns + 1))
    assert (command.mode, bench.status.reason) == (Mode.HOLD, Reason.STALE)
    command = bench.step(aged(bench, 90.0, in_queue=True, enable=False))
    assert (command.mode, command.enable) == (Mode.OFF, False)


def test_frames_that_cannot_be_used_do_not_make_the_command_younger(bench_of):
    """Held on pressures of an age of 25 ms, with fresh frames of an invalid sensor: shut when the old are 80 ms."""
    bench = controlling(bench_of(hold_periods=3, decay_periods=0))
    assert bench.step(aged(bench, 25.0, in_queue=True)).enable
    seen = []
    for _ in range(3):
        command = bench.step(bench.pressure(valid=(True, True, True, False)))
        seen.append((command.mode, command.enable, bench.status.reason))
    # At 45, 65 and 85 ms.
    held = (Mode.HOLD, True, Reason.SENSOR_INVALID)
    assert seen == [held, held, (Mode.HOLD, False, Reason.STALE)]
    assert bench.ecu.trace.interventions == Intervention.STALE
    assert bench.step(bench.pressure()).mode is Mode.CONTROL
    assert bench.status.reason is Reason.NONE


def test_of_several_frames_the_newest_counts_and_a_repeated_one_is_a_miss_and_no_crc_error(bench):
    bench.into_control()
    frames = [bench.pressure((value,) * 4) for value in (0.2, 0.5, 0.8)]
    assert bench.step(*frames).mode is Mode.CONTROL
    assert bench.controller.calls[-1][0][-1, 0] == pytest.approx(0.8, abs=1e-3)
    assert bench.step(frames[-1]).mode is Mode.HOLD
    assert (bench.status.crc_errors, bench.ecu.frames_rejected) == (0, 1)
    # The same again next to a new one does no harm.
    assert bench.step(frames[-1], bench.pressure()).mode is Mode.CONTROL


@each(
    "pattern, expected, reason",
    [
        # G a good frame, c a corrupted one, x none.
        ("x x x x", "HDDF", Reason.STREAM_LOST),
        # The third wrong CRC among five ends the trust in the stream, whatever good frames came with it.
        ("c c c c", "HDFF", Reason.STREAM_INVALID),
        ("c G c G c", "HCHCF", Reason.STREAM_INVALID),
        ("cG cG cG", "CCF", Reason.STREAM_INVALID),
        ("Gc Gc Gc", "CCF", Reason.STREAM_INVALID),
        ("ccG Gcc cGc", "CCF", Reason.STREAM_INVALID),
        ("cccG cccG cccG cccG", "CCFF", Reason.STREAM_INVALID),
        ("x c x c x", "HDDFF", Reason.STREAM_LOST),
        ("G c c x G c c x", "CHDDCFFF", Reason.STREAM_INVALID),
    ],
)
def test_lost_frames_hold_and_decay_and_a_stream_not_to_be_trusted_shuts_at_once(bench_of, pattern, expected, reason):
    bench = bench_of()
    bench.into_control()
    bench.good(5)
    modes = ""
    for period in pattern.split():
        frames = [bench.pressure() for kind in period if kind != "x"]
        frames = [
            replace(frame, data=frame.data[:9] + bytes([frame.data[9] ^ 32]) + frame.data[10:])
            if kind == "c"
            else frame
            for kind, frame in zip(period, frames, strict=False)
        ]
        modes += bench.step(*frames).mode.name[0]
    assert (modes, bench.status.reason) == (expected, reason)


def test_errors_of_the_can_controller_are_reported_and_borne_short_of_bus_off(bench):
    bench.into_control()
    for health, mode, reason in [
        (BusHealth(state=BusState.ERROR_PASSIVE, tx_errors=200, rx_errors=130), Mode.CONTROL, Reason.NONE),
        (BusHealth(bus_off=1), Mode.FAULT, Reason.BUS_OFF),  # which it was and is no more
    ]:
        answers = bench.ecu.step(bench.now_ns, [bench.pressure()], health)
        bench.now_ns += bench.config.period_ns
        command, status = codec.parse_jet_command(answers[0].data), codec.parse_ecu_status(answers[1].data)
        assert command is not None and status is not None
        assert (command.mode, status.reason) == (mode, reason)
        reported = (status.tx_errors, status.rx_errors, status.bus_off)
        assert reported == (health.tx_errors, health.rx_errors, health.bus_off)
