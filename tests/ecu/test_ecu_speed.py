"""A release that serves a range of speeds: what the controller reads, what the jets get, and when they are shut."""

import numpy as np
import pytest

from can_bridge.wire.messages import EcuStatus, Mode, Reason
from contract.config.operating_point import OperatingPoint
from contract.release.manifest import SpeedRange
from tests.ecu.conftest import WINDOW, Bench, RecordingController, make_bench, make_bundle

SCALE, DESIGN = OperatingPoint().flow_rate_scale, OperatingPoint().speed
PERIOD_MS = 20.0


def bench_at(plan: float = 0.01, **settings) -> Bench:
    bench = make_bench(
        RecordingController(lambda i: plan),
        bundle=make_bundle(speeds=SpeedRange(slowest=0.6, fastest=1.4)),
        rearm_frames=1,
        **settings,
    )
    bench.cruises = None
    return bench


def drive(bench: Bench, ratio: float | None, periods: int, cp: float = 0.1, **stated) -> list:
    """Periods at a speed, with this Cp at the present dynamic pressure on all sensors."""
    pressure = (cp * (1.0 if ratio is None else ratio) ** 2,) * 4
    return [bench.step(bench.speed(ratio, **stated), bench.pressure(pressure)) for _ in range(periods)]


def status(bench: Bench) -> EcuStatus:
    assert bench.status is not None
    return bench.status


def reason(bench: Bench) -> Reason:
    return status(bench).reason


def test_the_window_has_steps_of_the_present_speed_and_the_jets_follow_it():
    """Faster and then slower: a row lies as far back in lengths travelled as the controller expects it."""
    bench, at = bench_at(), 0.0
    for ratio in [1.2] * 8 + [1.15, 1.1, 1.05, 1.05, 1.1]:
        at += ratio
        # Cp grows along the way: Pa follow the present dynamic pressure.
        bench.step(bench.speed(ratio), bench.pressure((0.02 * at * ratio**2,) * 4))
    window, _, _ = bench.controller.calls[-1]
    # Half a step of a pressure on the wire, of 375 Pa at the design speed.
    np.testing.assert_allclose(window[:, 0], 0.02 * (at - np.arange(WINDOW)[::-1]), atol=1.5e-4)
    # What the jets had reached is 0.01 of the speed before.
    assert window[-1, 4] == pytest.approx(0.01 * 1.05 / 1.1, abs=2e-5)
    assert bench.good(1)[0].flow_m2_per_s == pytest.approx(0.01 * 1.1 * SCALE, abs=1.01e-4)


def test_below_the_design_speed_commands_and_pressures_follow_by_the_share_of_a_step():
    bench = bench_at()
    drive(bench, 0.8, 8, cp=0.1)
    sent = [command.flow_m2_per_s / SCALE for command in drive(bench, 0.8, 30, cp=0.2)]
    window, _, _ = bench.controller.calls[-30]
    assert window[-1, 0] == pytest.approx(0.1 + 0.8 * 0.1, abs=4e-4)
    assert bench.controller.calls[-29][0][-1, 0] == pytest.approx(0.2 - 0.2**2 * 0.1, abs=4e-4)
    assert sent[-1] == pytest.approx(0.01 * 0.8, abs=1e-5)


def test_without_a_speed_the_last_one_stands_for_a_while_and_then_no_pressure_is_usable():
    bench = bench_at()
    assert not bench.good(3)[-1].enable and reason(bench) is Reason.NO_SPEED
    bench = bench_at()
    drive(bench, 1.0, 6)
    assert status(bench).state is Mode.CONTROL
    for unknown in (lambda: (), lambda: (bench.speed(None),)):
        modes = []
        while reason(bench) is Reason.NONE:
            modes.append(bench.step(*unknown(), bench.pressure()).mode)
        assert len(modes) == 500.0 / PERIOD_MS + 1
        assert set(modes[:-1]) == {Mode.CONTROL} and reason(bench) is Reason.NO_SPEED
        modes = [bench.step(bench.pressure()).mode for _ in range(3)]
        assert modes == [Mode.DECAY, Mode.DECAY, Mode.FAULT]
        # As after any latched fault: a new request, and the stream of speeds is to be trusted again.
        [bench.step(bench.speed(1.0), bench.pressure(enable=False)) for _ in range(2)]
        drive(bench, 1.0, 6)
        assert status(bench).state is Mode.CONTROL


def test_outside_its_speeds_the_jets_are_shut_and_come_back_by_themselves_with_hysteresis():
    bench = bench_at()
    drive(bench, 1.0, 8)
    for ratio in (0.95, 0.9, 0.85, 0.8, 0.75, 0.7, 0.65, 0.6, 0.57, 0.53):
        assert drive(bench, ratio, 5)[-1].mode is Mode.CONTROL, ratio
    # Beyond its end the range's end stands for the speed: the pressures are the air's, whose speed may be there.
    assert bench.controller.calls[-1][0][-1, 0] == pytest.approx(0.1 * (0.53 / 0.6) ** 2, abs=6e-3)
    commands = drive(bench, 0.52, 1)
    assert (commands[0].mode, commands[0].flow_m2_per_s, reason(bench)) == (Mode.WARMUP, 0.0, Reason.OFF_SPEED)
    # Standing still is no fault either, however long it lasts.
    for ratio in (0.5, 0.4, 0.2, 0.0):
        drive(bench, ratio, 20)
        assert (status(bench).state, reason(bench)) == (Mode.WARMUP, Reason.OFF_SPEED), ratio
    for ratio in (0.2, 0.4, 0.5, 0.59):
        drive(bench, ratio, 20)
    assert reason(bench) is Reason.OFF_SPEED
    # The window begins again: no row of another speed is planned on.
    modes = [command.mode for command in drive(bench, 0.61, 8)]
    assert modes[:3] == [Mode.WARMUP] * 3 and modes[-1] is Mode.CONTROL and reason(bench) is Reason.NONE


def test_a_speed_is_not_believed_before_a_vehicle_could_have_reached_it():
    bench = bench_at()
    drive(bench, 1.0, 8)
    # 6.25 m/s at 15 m/s2 at most.
    for periods, ratio in ((20, 1.0), (1, 1.25)):
        drive(bench, 1.25, periods)
        assert bench.ecu.state.speed.ratio == pytest.approx(ratio)


def test_old_speeds_do_not_count_and_the_density_scales_the_pressures():
    bench = bench_at()
    drive(bench, 1.0, 8)
    drive(bench, 1.02, 3, age_ns=600_000_000)
    assert bench.ecu.state.speed.ratio == 1.0
    drive(bench, 1.0, 2, cp=0.1, density=0.6)
    assert bench.controller.calls[-1][0][-1, 0] == pytest.approx(0.2, abs=4e-4)
