"""Whether control helps: judged against means that are computed here, and in an ECU whose jets do nothing."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from can_bridge.wire.messages import Mode, Reason
from contract.config.vehicle import BenefitCheckConfig, SensorCheckConfig
from contract.recording import dataset
from contract.release.bundle import load
from contract.shipped import BUNDLE, recording
from ecu.benefit_check import MOVED, PATIENCE, UNSTATED, BenefitCheck, BenefitCheckState, mirrored_pairs
from tests.ecu.conftest import RecordingController, make_bench

RELEASE = load(BUNDLE)
CONFIG = BenefitCheckConfig(mean_periods=8, wake_periods=20, first_period=10, least_gain=0.1, doubt_periods=5)
CHECK = BenefitCheck(base=(2, 3), pairs=((0, 1), (2, 3)), config=CONFIG)
SHORTEST = CONFIG.first_period + CONFIG.doubt_periods - 1
"""Periods of control that does not help until it is tested, and of a test until it is over."""
WITHOUT = np.array([0.1, -0.3, -0.4, -0.6])  # mean base pressure -0.5, mean difference 0.3
SUCTION_UNIT, SWING_UNIT = UNSTATED[0][1:]
HELPED = np.array([-0.1, -0.2, -0.4, -0.4])


def run(state: BenefitCheckState, cp, periods: int, *, drives: bool, speed=1.0, check=CHECK) -> tuple[Any, list[bool]]:
    """After so many periods, and whether each asked for a test; none latched the fault."""
    tests = []
    for _ in range(periods):
        state, reason = check.next(state, cp, drives=drives, speed=speed)
        assert reason is None
        tests.append(state.tests)
    return state, tests


def suspected(check: BenefitCheck, rest, periods: int, driven, *, speeds=(1.0, 1.0)) -> bool:
    """Whether control is tested that has these pressures, after so many periods without it."""
    rested, _ = run(BenefitCheckState(), rest, periods, drives=False, speed=speeds[0], check=check)
    return run(rested, driven, SHORTEST, drives=True, speed=speeds[1], check=check)[1][-1]


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


def test_control_that_takes_no_suction_away_is_tested_after_a_cycle_of_doubt_and_useful_control_never():
    rested, _ = run(BenefitCheckState(), WITHOUT, 30, drives=False)
    for cp, helps in (
        (HELPED, True),
        (WITHOUT, False),
        (WITHOUT + np.array([0.0, 0.0, 0.04, 0.04]), False),  # 8 % of the suction
        (WITHOUT + np.array([0.0, 0.0, 0.06, 0.06]), True),
        (np.array([0.4, -0.4, -0.3, -0.3]), False),  # base pressure up, the wake bent aside
    ):
        _, tests = run(rested, cp, 60 if helps else SHORTEST, drives=True)
        assert tests == ([False] * 60 if helps else [False] * (SHORTEST - 1) + [True]), cp


def test_a_suspicion_is_tested_against_the_wake_at_this_speed_before_it_latches():
    rested, _ = run(BenefitCheckState(), WITHOUT, 30, drives=False)
    suspected, tests = run(rested, WITHOUT, SHORTEST, drives=True, speed=0.9)
    assert tests[-1]
    # The wake turns out to be the worse one: control had helped, and goes on.
    found, tests = run(suspected, 1.2 * WITHOUT, SHORTEST, drives=False, speed=0.9)
    assert tests == [True] * (SHORTEST - 1) + [False]
    assert found.resting_suction == pytest.approx(-1.2 * 0.5 / SUCTION_UNIT)
    assert not any(run(found, WITHOUT, 60, drives=True, speed=0.9)[1])
    # At another speed the test says nothing, but not before the wake could answer.
    moved, tests = run(suspected, WITHOUT, CONFIG.first_period, drives=False, speed=0.9 + 1.001 * MOVED)
    assert tests == [True] * (CONFIG.first_period - 1) + [False]
    # It is no worse, and the speed stays: the fault latches, the sooner if there was a test before.
    again, _ = run(moved, WITHOUT, SHORTEST, drives=True, speed=1.2)
    for state, spent in ((suspected, 0), (again, CONFIG.first_period)):
        near = state.tested_at + 0.999 * MOVED
        waited, tests = run(state, WITHOUT, CHECK.patience - spent - 1, drives=False, speed=near)
        # Frames that are lost say nothing, nor does what the fail-safe makes of them.
        silent, silence = run(waited, None, 40, drives=True)
        assert all(tests + silence)
        latched, reason = CHECK.next(silent, WITHOUT, drives=False, speed=near)
        assert (reason, latched.tests, latched.spent) == (Reason.NOT_HELPING, False, CHECK.patience)
    # Control that helps wins back what tests have taken.
    assert run(latched, HELPED, CHECK.patience + CONFIG.first_period, drives=True)[0].spent == 0


def test_means_are_in_units_of_the_wake_without_jets_at_the_speed_of_each_period():
    """A wake that is what it was, at a speed where it sheds more, is no reason to doubt; nor is less of it a gain."""
    check = replace(CHECK, resting=((0.8, -0.25, 0.075), (1.0, -0.5, 0.3), (1.4, -0.6, 0.42)))

    def shaped(cp: np.ndarray, base: float, swing: float) -> np.ndarray:
        """With the base's mean and the differences so many times as large."""
        mean = np.repeat(cp.reshape(2, 2).mean(axis=1), 2)
        return mean * np.array([1.0, 1.0, base, base]) + swing * (cp - mean)

    for speed, base, swing in ((0.7, 0.5, 0.25), (0.9, 0.75, 0.625), (1.0, 1.0, 1.0), (1.2, 1.1, 1.2), (1.5, 1.2, 1.4)):
        doubted = partial(suspected, check, shaped(WITHOUT, 0.5, 0.25), 30, speeds=(0.7, speed))
        assert not doubted(shaped(WITHOUT, 0.89 * base, swing))
        assert doubted(shaped(WITHOUT, 0.91 * base, swing))
        # The second bound: mirrored sensors differ more than without control.
        assert not doubted(shaped(WITHOUT, 0.5 * base, 1.14 * swing))
        assert doubted(shaped(WITHOUT, 0.5 * base, 1.16 * swing))


def test_a_wake_that_control_had_calmed_before_a_reset_is_not_taken_for_that_without_control():
    """Nor does the release's wake judge a vehicle that has measured its own for long enough."""
    stated, proven = replace(CHECK, resting=((1.0, -0.5, 0.3),)), CONFIG.wake_periods + CONFIG.mean_periods
    assert stated.proven == proven
    for periods in (1, proven - 1):
        assert not suspected(stated, HELPED, periods, HELPED)
        assert suspected(CHECK, HELPED, periods, HELPED)
        # As much suction as the release's wake has, or as much swing, is no calmed one.
        assert suspected(stated, HELPED, periods, WITHOUT)
        assert suspected(stated, 1.2 * WITHOUT, periods, 1.15 * WITHOUT)
    assert suspected(stated, HELPED, proven, HELPED)


def test_periods_without_pressures_judge_nothing_and_control_begins_anew_with_no_doubt():
    rested, _ = run(BenefitCheckState(), WITHOUT, 30, drives=False)
    doubted, _ = run(rested, WITHOUT, CONFIG.first_period + 2, drives=True)
    assert doubted.doubt == 3
    silent, tests = run(doubted, None, 40, drives=True)
    assert silent == doubted and not any(tests)
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


def test_no_recorded_control_is_tested():
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
            state, _ = check.next(state, row, drives=True)
            assert not state.tests, episode.name


def test_jets_that_change_nothing_are_shut_for_that_reason_and_a_new_request_tries_again():
    off = SensorCheckConfig(enabled=False)
    bench = make_bench(RecordingController(lambda i: 0.03), bundle=RELEASE, sensor_check=off, benefit_check=CONFIG)

    def drive(periods: int, *, enable: bool = True) -> list[Mode]:
        return [bench.step(bench.pressure(WITHOUT, enable=enable)).mode for _ in range(periods)]

    drive(80, enable=False)
    modes = drive(CONFIG.first_period + CONFIG.doubt_periods)
    assert set(modes[:-1]) == {Mode.CONTROL} and modes[-1] is Mode.WARMUP and bench.status.reason is Reason.NOT_HELPING
    modes = drive(PATIENCE * CONFIG.wake_periods)
    assert set(modes[:-1]) == {Mode.WARMUP} and modes[-1] is Mode.FAULT and bench.status.reason is Reason.NOT_HELPING
    assert set(drive(20)) == {Mode.FAULT}
    drive(6, enable=False)
    assert drive(6)[-1] is Mode.CONTROL
