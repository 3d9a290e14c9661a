"""Whether control helps: judged against means that are computed here, and in an ECU whose jets do nothing."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from can_bridge.wire.messages import Mode, Reason
from contract.config.vehicle import BenefitCheckConfig, SensorCheckConfig
from contract.recording import dataset
from contract.release.bundle import load
from contract.shipped import BUNDLE, recording
from firmware_sim.ecu.benefit_check import UNSTATED, BenefitCheck, BenefitCheckState, mirrored_pairs
from tests.firmware_sim.conftest import RecordingController, make_bench

RELEASE = load(BUNDLE)
CONFIG = BenefitCheckConfig(mean_periods=8, wake_periods=20, first_period=10, least_gain=0.1, doubt_periods=5)
CHECK = BenefitCheck(base=(2, 3), pairs=((0, 1), (2, 3)), config=CONFIG)
WITHOUT = np.array([0.1, -0.3, -0.4, -0.6])
"""Mean base pressure -0.5, mean difference 0.3."""
SUCTION_UNIT, SWING_UNIT = UNSTATED[0][1:]
HELPED = np.array([-0.1, -0.2, -0.4, -0.4])


def run(state: BenefitCheckState, cp: np.ndarray | None, periods: int, *, drives: bool) -> tuple[Any, list[Any]]:
    reasons = []
    for _ in range(periods):
        state, reason = CHECK.next(state, cp, drives=drives)
        reasons.append(reason)
    return state, reasons


def test_means_without_control_are_those_of_the_latest_periods_and_none_while_the_wake_still_wakes():
    rng, state = np.random.default_rng(0), BenefitCheckState()
    rows = rng.normal(-0.3, 0.2, (30, 4))
    for k, row in enumerate(rows, 1):
        state, _ = CHECK.next(state, row, drives=False)
        # As long as the mean is short it is the plain one.
        if k <= CONFIG.mean_periods:
            swing = np.abs(rows[:k, [0, 2]] - rows[:k, [1, 3]]).mean()
            assert state.resting_suction == pytest.approx(rows[:k, 2:].mean() / SUCTION_UNIT)
            assert state.resting_swing == pytest.approx(swing / SWING_UNIT)
    weights = (1 - 1 / 8) ** np.arange(22)[::-1] / 8
    mean = (1 - 1 / 8) ** 22 * rows[:8, 2:].mean() + weights @ rows[8:, 2:].mean(axis=1)
    assert state.resting_suction == pytest.approx(mean / SUCTION_UNIT)
    driven, _ = run(state, WITHOUT, 3, drives=True)
    waking, _ = run(driven, HELPED, CONFIG.wake_periods - 1, drives=False)
    assert waking.resting_suction == state.resting_suction
    awake, _ = run(waking, HELPED, 1, drives=False)
    before = state.resting_suction
    assert awake.resting_suction == pytest.approx(before + (-0.4 / SUCTION_UNIT - before) / 8)


def test_control_that_takes_no_suction_away_is_ended_after_a_cycle_of_doubt_and_useful_control_never():
    rested, _ = run(BenefitCheckState(), WITHOUT, 30, drives=False)
    for cp, helps in (
        (HELPED, True),
        (WITHOUT, False),
        (WITHOUT + np.array([0.0, 0.0, 0.04, 0.04]), False),  # 8 % of the suction
        (WITHOUT + np.array([0.0, 0.0, 0.06, 0.06]), True),
        (np.array([0.4, -0.4, -0.3, -0.3]), False),  # base pressure up, the wake bent aside
    ):
        _, reasons = run(rested, cp, 60, drives=True)
        first = CONFIG.first_period + CONFIG.doubt_periods - 2
        ended = [None] * first + [Reason.NOT_HELPING] * (60 - first)
        assert reasons == ([None] * 60 if helps else ended), cp


def test_means_are_in_units_of_the_wake_without_jets_at_the_speed_of_each_period():
    """A wake that is what it was, at a speed where it sheds more, is no reason to doubt; nor is less of it a gain."""
    check = replace(CHECK, resting=((0.8, -0.25, 0.075), (1.0, -0.5, 0.3), (1.4, -0.6, 0.42)))

    def judged(speed: float, cp: np.ndarray) -> Reason | None:
        state, reason = BenefitCheckState(), None
        for _ in range(30):
            state, _ = check.next(state, shaped(WITHOUT, 0.5, 0.25), drives=False, speed=0.7)
        for _ in range(60):
            state, reason = check.next(state, cp, drives=True, speed=speed)
        return reason

    def shaped(cp: np.ndarray, base: float, swing: float) -> np.ndarray:
        """With the base's mean and the differences so many times as large."""
        mean = np.repeat(cp.reshape(2, 2).mean(axis=1), 2)
        return mean * np.array([1.0, 1.0, base, base]) + swing * (cp - mean)

    for speed, base, swing in ((0.7, 0.5, 0.25), (0.9, 0.75, 0.625), (1.0, 1.0, 1.0), (1.2, 1.1, 1.2), (1.5, 1.2, 1.4)):
        assert judged(speed, shaped(WITHOUT, 0.89 * base, swing)) is None
        assert judged(speed, shaped(WITHOUT, 0.91 * base, swing)) is Reason.NOT_HELPING
        # The second bound: mirrored sensors differ more than without control.
        assert judged(speed, shaped(WITHOUT, 0.5 * base, 1.14 * swing)) is None
        assert judged(speed, shaped(WITHOUT, 0.5 * base, 1.16 * swing)) is Reason.NOT_HELPING


def test_a_wake_that_control_had_calmed_before_a_reset_is_not_taken_for_that_without_control():
    """Nor does the release's wake judge a vehicle that has measured its own for long enough."""
    proven = CONFIG.wake_periods + CONFIG.mean_periods

    def judged(check: BenefitCheck, rest: np.ndarray, periods: int, driven: np.ndarray) -> Reason | None:
        state, reason = BenefitCheckState(), None
        for _ in range(periods):
            state, _ = check.next(state, rest, drives=False)
        for _ in range(60):
            state, reason = check.next(state, driven, drives=True)
        return reason

    stated = replace(CHECK, resting=((1.0, -0.5, 0.3),))
    assert stated.proven == proven
    for periods in (1, proven - 1):
        assert judged(stated, HELPED, periods, HELPED) is None
        assert judged(CHECK, HELPED, periods, HELPED) is Reason.NOT_HELPING
        # As much suction as the release's wake has, or as much swing, is no calmed one.
        assert judged(stated, HELPED, periods, WITHOUT) is Reason.NOT_HELPING
        assert judged(stated, 1.2 * WITHOUT, periods, 1.1 * WITHOUT) is Reason.NOT_HELPING
    assert judged(stated, HELPED, proven, HELPED) is Reason.NOT_HELPING


def test_periods_without_pressures_judge_nothing_and_control_begins_anew_with_no_doubt():
    rested, _ = run(BenefitCheckState(), WITHOUT, 30, drives=False)
    doubted, _ = run(rested, WITHOUT, CONFIG.first_period + 2, drives=True)
    assert doubted.doubt == 3
    silent, reasons = run(doubted, None, 40, drives=True)
    assert silent == doubted and not any(reasons)
    shut, _ = run(doubted, None, 1, drives=False)
    assert (shut.driven, shut.doubt, shut.waking) == (0, 0, CONFIG.wake_periods - 1)
    # Nothing to compare with: nothing is judged.
    assert not any(run(BenefitCheckState(), WITHOUT, 60, drives=True)[1])


def test_a_release_names_its_base_and_its_pairs_or_there_is_no_check():
    manifest = RELEASE.manifest
    check = BenefitCheck.of(manifest, BenefitCheckConfig())
    assert check is not None
    assert [manifest.sensors[place] for place in check.base] == ["base_0", "base_9"]
    assert check.pairs == ((0, 1), (2, 3))
    assert mirrored_pairs(replace(manifest, sensor_positions=None)) == check.pairs
    assert mirrored_pairs(replace(manifest, sensors=("a", "b", "c", "d"), sensor_positions=None)) == ()
    sides = replace(manifest, sensors=("upper_1", "lower_1", "upper_39", "lower_39"))
    assert BenefitCheck.of(sides, BenefitCheckConfig()) is None
    assert BenefitCheck.of(manifest, BenefitCheckConfig(enabled=False)) is None


def test_no_recorded_control_is_ended():
    """Eight episodes of 220 t_c under a controller, against the wake without one."""
    check = BenefitCheck.of(RELEASE.manifest, BenefitCheckConfig())
    assert check is not None
    read = dataset.read(recording())
    columns = read.layout.indices(RELEASE.manifest.sensors)
    rested = BenefitCheckState()
    (without,) = (one for one in read.episodes if one.name == "none_0")
    for row in without.series["Cp"][:100, columns]:
        rested, _ = check.next(rested, row, drives=False)
    controlled = [one for one in read.episodes if one.name.startswith("controlled")]
    assert len(controlled) == 8
    for episode in controlled:
        state = rested
        for row in episode.series["Cp"][:, columns]:
            state, reason = check.next(state, row, drives=True)
            assert reason is None, episode.name


def test_jets_that_change_nothing_are_shut_for_that_reason_and_a_new_request_tries_again():
    bench = make_bench(
        RecordingController(lambda i: 0.03), bundle=RELEASE, sensor_check=SensorCheckConfig(enabled=False)
    )

    def drive(periods: int, *, enable: bool = True) -> list[Mode]:
        return [bench.step(bench.pressure(WITHOUT, enable=enable)).mode for _ in range(periods)]

    drive(100, enable=False)
    own = BenefitCheckConfig()
    modes = drive(own.first_period + own.doubt_periods + 1)
    assert set(modes[:-3]) == {Mode.CONTROL} and modes[-1] is Mode.FAULT
    assert bench.status is not None and bench.status.reason is Reason.NOT_HELPING
    assert set(drive(20)) == {Mode.FAULT}
    drive(6, enable=False)
    assert drive(6)[-1] is Mode.CONTROL
