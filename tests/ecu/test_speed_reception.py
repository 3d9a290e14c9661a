"""The correction of the speed on the bus: its features, its limits, and when it stays as it is."""

from dataclasses import replace

import numpy as np
import pytest

from can_bridge.wire.messages import Mode, Reason
from contract.arrays import Array
from contract.config.vehicle import SpeedConfig
from contract.controller.air_speed import FIRST_PERIOD, LAGS, MEAN_PERIODS, feature_count, features, weight_count
from contract.release.manifest import SpeedRange
from ecu.pressure_reception import SILENCE_NS, OtherEcu
from ecu.speed_reception import MOST_REST, RATE, TOLERATED, AirSpeed, AirSpeedState
from tests.ecu.conftest import RecordingController, make_bench, make_bundle

ROWS, MOST = max(LAGS) + 2, 0.12
SPEEDS = SpeedRange(slowest=0.6, fastest=1.4)
ANY = (0.0, 9.0)


def windows(count: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(0.0, 0.3, (count, ROWS, 5))


def constant(estimate: float) -> AirSpeed:
    return AirSpeed(weights=np.array([0.0] * (weight_count(2) - 1) + [estimate]), pairs=2, most=MOST)


def after(air: AirSpeed, periods: int, state: AirSpeedState | None = None, *, drives: bool = True) -> AirSpeedState:
    state = air.start if state is None else state
    for window in windows(periods):
        state = air.next(state, window, drives=drives, within=ANY)
    return state


def test_features_are_the_sums_and_products_at_their_distances_and_the_same_in_the_mirror():
    window = windows(1)[0]
    signals = [[row[0] - row[1], row[2] - row[3], row[4]] for row in window]
    expected = [window[-1][0] + window[-1][1], window[-1][2] + window[-1][3]]
    expected += [one * other for lag in LAGS for one in signals[-1] for other in signals[-1 - lag]]
    assert features(window).tolist() == pytest.approx(expected, rel=1e-12)
    assert len(expected) == feature_count(2) == weight_count(2) - 3
    mirrored = window[:, [1, 0, 3, 2, 4]] * [1, 1, 1, 1, -1]
    assert np.array_equal(features(mirrored), features(window))


def test_the_estimate_is_the_weighted_sum_of_means_over_the_latest_periods():
    weights = np.random.default_rng(1).normal(0.0, 0.1, weight_count(2))
    air = AirSpeed(weights=weights, pairs=2, most=MOST)
    seen = np.array([features(each) for each in windows(FIRST_PERIOD)])
    share = np.full(FIRST_PERIOD, 1.0 / MEAN_PERIODS)
    share[:MEAN_PERIODS] = 1.0 / np.arange(1, MEAN_PERIODS + 1)
    means = seen[0]
    for row, part in zip(seen[1:], share[1:], strict=True):
        means = (1.0 - part) * means + part * row
    estimate = weights @ [*means, *means[:2] ** 2, 1.0]
    found = after(air, FIRST_PERIOD)
    assert found.means == pytest.approx(means, rel=1e-9)
    assert abs(estimate) > TOLERATED
    rest = np.clip(estimate - np.sign(estimate) * TOLERATED, -MOST_REST, MOST_REST)
    assert found.correction == pytest.approx(1.0 - RATE * rest, rel=1e-12)


def test_a_speed_in_use_that_is_too_low_rises_and_never_by_more_than_the_setting():
    for estimate, limit in ((-0.1, 1.0 + MOST), (0.1, 1.0 - MOST)):
        air, state = constant(estimate), after(constant(estimate), FIRST_PERIOD)
        rest = estimate - np.sign(estimate) * TOLERATED
        assert state.correction == pytest.approx(1.0 - RATE * rest)
        assert after(air, 10, state).correction == pytest.approx((1.0 - RATE * rest) ** 11)
        assert after(air, 1000, state).correction == limit
    for estimate in (0.99 * TOLERATED, -0.99 * TOLERATED):
        assert after(constant(estimate), FIRST_PERIOD + 50).correction == 1.0


def test_it_waits_for_the_controlled_wake_and_keeps_its_correction_while_nothing_can_be_judged():
    air = constant(-0.1)
    assert after(air, FIRST_PERIOD - 1).correction == 1.0
    held = after(air, FIRST_PERIOD + 20)
    assert held.correction > 1.0
    assert air.next(held, None, drives=True, within=ANY) is held
    shut = after(air, 5, held, drives=False)
    assert (shut.correction, shut.driven) == (held.correction, 0)
    assert after(air, FIRST_PERIOD - 1, shut).correction == held.correction
    assert after(air, FIRST_PERIOD, shut).correction > held.correction


def test_the_ecu_scales_with_the_corrected_speed_within_the_releases_range():
    weights = (*(0.0,) * (weight_count(2) - 1), -0.2)
    bundle = make_bundle(window=ROWS, speeds=SPEEDS, air_speed=weights)
    # Beyond the range a correction would have no effect, and would last when the vehicle slows down.
    for told, used in ((1.0, 1.0 + MOST), (1.35, SPEEDS.fastest), (1.4, SPEEDS.fastest)):
        bench = make_bench(RecordingController(), bundle=bundle, rearm_frames=1)
        bench.cruises = None
        for _ in range(ROWS + FIRST_PERIOD + 400):
            bench.step(bench.at_speed(told), bench.pressure((0.1, 0.1, 0.1, 0.1)))
        window, *_ = bench.controller.calls[-1]
        assert bench.ecu.state.speed.air.correction == pytest.approx(used / told)
        # The bench's pressures are Cp at the design speed.
        assert window[-1, :4] == pytest.approx([0.1 / used**2] * 4, rel=0.01)
    unused = make_bench(RecordingController(), bundle=bundle, rearm_frames=1, speed=SpeedConfig(most_correction=0.0))
    for _ in range(ROWS + FIRST_PERIOD + 10):
        unused.step(unused.pressure((0.1, 0.1, 0.1, 0.1)))
    air = unused.ecu.state.speed.air
    assert (air.driven, air.correction) == (FIRST_PERIOD, 1.0)
    assert AirSpeed.of(replace(bundle.manifest, air_speed=None), MOST) is None


def test_after_a_clock_that_went_back_no_earlier_speed_is_in_force():
    bench = make_bench(RecordingController(), bundle=make_bundle(speeds=SPEEDS))
    bench.cruises, bench.now_ns = None, 100 * 10**9
    for _ in range(10):
        bench.step(bench.at_speed(1.0), bench.pressure())
    assert bench.ecu.trace.mode is Mode.CONTROL
    bench.now_ns -= 60 * 10**9
    bench.step(bench.pressure())
    assert (bench.ecu.state.speed.ratio, bench.ecu.state.fail_safe.reason) == (None, Reason.CLOCK)
    # Otherwise this change of speed would not be possible until the clock shows the earlier time again.
    for _ in range(3):
        bench.step(bench.at_speed(1.1), bench.pressure())
    assert bench.ecu.state.speed.ratio == pytest.approx(1.1)


def test_after_a_clock_that_went_back_another_ecus_silence_counts_from_then_on():
    present = OtherEcu().next(1, 60 * 10**9)
    after = present.next(0, 0)
    assert (after.until_ns, after.next(0, SILENCE_NS).until_ns) == (SILENCE_NS, SILENCE_NS)
    assert after.next(0, SILENCE_NS + 1) == OtherEcu(frames=1)
    assert present.next(0, 60 * 10**9 + SILENCE_NS) == present
