"""The sensor check against liars that are planted, with an estimator whose answers are known.

All sensors see one oscillation, each about a level of its own; what a view estimates is the mean of the sensors that it
sees, moved to that level. So residuals of sound sensors are 0 but for the noise that a test puts in. At the end, the
ECU with the shipped estimator on recorded pressures.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire.messages import Mode, Reason
from contract import sensors
from contract.arrays import Array
from contract.config.vehicle import BenefitCheckConfig, SensorCheckConfig
from contract.controller.estimator import views
from contract.controller.interface import ControllerError
from contract.recording import dataset
from contract.release import bundle
from contract.release.checks import Bundle
from contract.release.manifest import SensorEstimator
from contract.shipped import BUNDLE, recording
from ecu.sensor_check import SensorCheck, SensorCheckState
from tests.each import each
from tests.ecu.conftest import RecordingController, make_bench
from tests.examples import examples

LENGTH = 8
LEVELS = np.array([-0.3, -0.36, -0.42, -0.37])
SHIFT = np.array([0.0, 0.0, 0.5, 0.5]) * np.pi  # of the phase: two sensors on either side


class Flow:
    """Four pressures of one oscillation, and the estimator that knows it."""

    def readings(self, step: int) -> Array:
        """Cp, (4,): a period of 30 steps, as the wake's."""
        return LEVELS + 0.25 * np.sin(2 * np.pi * step / 30 + SHIFT)

    def estimates(self, window: Array) -> Array:
        """By least squares of amplitude and phase over what the view sees of the window, which are linear in it."""
        of_zeros, slopes = _affine(len(window))
        return of_zeros + np.tensordot(window.ravel(), slopes, axes=1)


@cache
def _affine(length: int) -> tuple[Array, Array]:
    """Estimates of a window of zeros, and their slopes by each of its numbers."""
    time = 2 * np.pi * np.arange(-length + 1, 1) / 30
    basis = [np.column_stack([np.sin(time + phase), np.cos(time + phase)]) for phase in SHIFT]
    windows, found = np.concatenate([np.zeros((1, length, 5)), np.eye(5 * length).reshape(-1, length, 5)]), []
    for view in views(4):
        used = [j for j in range(4) if j not in view.left_out]
        seen = windows[:, :, view.order(4)][:, :, used] - LEVELS[used]
        amplitudes = (
            np.linalg.pinv(np.concatenate([basis[j] for j in used])) @ seen.swapaxes(1, 2).reshape(len(windows), -1).T
        )
        found.append(LEVELS + amplitudes.T @ np.array([np.sin(SHIFT), np.cos(SHIFT)]))
    of_zeros, *others = np.stack(found, axis=1)
    return of_zeros, np.array(others) - of_zeros


class Drive:
    """Steps a check; `read` is what becomes of the readings."""

    def __init__(self) -> None:
        deviations = tuple((0.02,) * 4 for _ in range(4))
        self.check = SensorCheck.of(SensorEstimator(fast=deviations, slow=deviations), Flow(), SensorCheckConfig())
        self.state = SensorCheckState.start(window=LENGTH, sensors=4)
        self.window, self.rows, self.now = np.zeros((LENGTH, 5)), 0, 0
        self.fault: Reason | None = None

    def step(self, read: Callable[[Array, int], Array] = lambda cp, k: cp, *, heard: bool = True) -> None:
        cp = read(Flow().readings(self.now), self.now)
        row = np.append(cp if heard or not self.rows else self.window[-1, :4], 0.0)
        self.window = np.concatenate([self.window[1:], row[None]])
        self.rows = min(self.rows + 1, LENGTH)
        self.state, self.fault = self.check.next(self.state, self.window, self.rows, cp if heard else None)
        self.now += 1

    def until_seen(self, read: Callable[[Array, int], Array], most: int) -> int:
        """Steps with a fault until the check finds something."""
        for count in range(1, most + 1):
            self.step(read)
            if self.state.set_aside is not None or self.fault is not None:
                return count
        raise AssertionError(f"nothing seen in {most} periods")


@cache
def _sound() -> Drive:
    drive = Drive()
    for _ in range(100):
        drive.step()
    return drive


def sound() -> Drive:
    return copy(_sound())


def with_value(j: int, value: Callable[[float, int], float]) -> Callable[[Array, int], Array]:
    def read(cp: Array, k: int) -> Array:
        read_as = cp.copy()
        read_as[j] = value(cp[j], k)
        return read_as

    return read


@pytest.mark.slow  # runs of every lie
@each("j", range(4))
@each(
    "fault, most",
    [
        (lambda value, k: 0.001 * (-1) ** k, 10),
        (lambda value, k: value + 0.15, 20),
        (lambda value, k: value - 0.15, 20),
        (lambda value, k: value + 0.004 * (k - 100), 45),
        (lambda value, k: -0.35 + 0.001 * (-1) ** k, 30),
        # Its last sound reading stays.
        (lambda value, k: None, SensorCheckConfig().flat_periods),
    ],
)
def test_a_liar_is_set_aside_in_time_and_control_goes_on(j, fault, most) -> None:
    drive = sound()
    held = float(drive.window[-1, j])
    lie = with_value(j, lambda value, k: held if (read := fault(value, k)) is None else read)
    drive.until_seen(lie, most)
    assert (drive.state.set_aside, drive.fault, drive.state.mask) == (j, None, 1 << j)


@each("scale", [0.0, 0.01])
@pytest.mark.slow
def test_one_that_rests_while_the_others_hardly_move_is_not_set_aside_for_good(scale: float) -> None:
    """A vehicle that stands or creeps: pressures of a few steps of the wire, and by chance one does not change."""
    drive = Drive()
    drive.until_seen(lambda cp, k: np.array([0.0, 1.0, 1.0, 1.0]) * scale * cp, 60)
    assert (drive.state.set_aside, drive.fault) == (None, Reason.IMPLAUSIBLE)
    # When it drives, the pressures are believed again.
    for _ in range(300):
        drive.step()
    assert (drive.state.set_aside, drive.fault) == (None, None)


@each("order", [[2, 1, 0, 3], [3, 1, 2, 0], [0, 2, 1, 3], [0, 3, 2, 1]])
def test_exchanged_sensors_shut_the_jets(order: list[int]) -> None:
    drive = sound()
    assert drive.until_seen(lambda cp, k: cp[order], 100)
    assert (drive.fault, drive.state.set_aside) == (Reason.IMPLAUSIBLE, None)


COPIES = {
    "the mean of all": lambda cp, k: np.full(4, cp.mean()),
    "the first of all": lambda cp, k: np.full(4, cp[0]),
    "three of one": lambda cp, k: cp[[1, 1, 1, 3]],
    "two of one, within a step of the wire": lambda cp, k: cp[[0, 1, 2, 2]] + 0.0003 * np.array([0, 0, 0, k % 2]),
}


def test_readings_that_are_copies_of_each_other_shut_the_jets_or_their_sensor_is_set_aside() -> None:
    for name, read in COPIES.items():
        drive = sound()
        drive.until_seen(read, LENGTH)
        for _ in range(LENGTH):
            drive.step(read)
        two = name.startswith("two")
        assert drive.fault is Reason.IMPLAUSIBLE or (two and drive.state.set_aside == 3), name
        # It ends with the copies: the periods in doubt have to pass, and those of the window.
        for _ in range(60):
            drive.step()
        assert drive.fault is None, name


def test_a_calm_symmetric_wake_has_no_copies() -> None:
    """Readings that are the same, and an estimator that expects just them: only how far they move tells copies."""

    class Same(Flow):
        def estimates(self, window: Array) -> Array:
            return np.tile(window[-1, :4], (len(views(4)), 1))

    def read(share: float) -> Callable[[Array, int], Array]:
        return lambda cp, k: np.full(4, LEVELS[0] + share * (cp[0] - LEVELS[0]))

    for share, fault in ((0.04, None), (1.0, Reason.IMPLAUSIBLE)):
        drive = Drive()
        drive.check = replace(drive.check, estimator=Same())
        for _ in range(100):
            drive.step(read(share))
        assert drive.fault is fault, share


def test_a_second_liar_shuts_the_jets() -> None:
    # Residuals squared of 26 sound variances are what a gust makes of sound sensors, a second liar's 122.
    for second, fault in ((-0.14, None), (-0.5, Reason.IMPLAUSIBLE)):
        drive = sound()
        drive.until_seen(with_value(0, lambda value, k: value + 0.4), 30)
        for _ in range(80):
            drive.step(lambda cp, k: cp + np.array([0.4, 0.0, 0.0, second]))  # noqa: B023
        assert (drive.state.set_aside, drive.fault) == (0, fault), second
    # Plausible again, the fault ends and the first liar stays aside.
    for _ in range(300):
        drive.step()
    assert (drive.state.set_aside, drive.fault) == (0, None)


@pytest.mark.slow  # long runs
@given(st.integers(0, 2**32), st.floats(0.0, 0.115))
@examples(8)
def test_noise_on_all_sensors_is_borne(seed: int, level: float) -> None:
    rng, drive = np.random.default_rng(seed), Drive()
    for _ in range(200):
        drive.step(lambda cp, k: cp + level * rng.standard_normal(4))
        assert (drive.state.set_aside, drive.fault) == (None, None)


def test_lost_frames_are_no_lies() -> None:
    drive = sound()
    for k in range(40):
        before = drive.state
        drive.step(heard=k % 3 == 0)
        assert (drive.state.set_aside, drive.fault) == (None, None)
        if k % 3:
            assert np.array_equal(drive.state.score, before.score)
            # The estimator here takes no repeated rows: the window is as if the frames had come.
            drive.window[-1, :4] = Flow().readings(drive.now - 1)


def test_periods_left_out_move_the_estimates_with_the_window() -> None:
    drive = sound()
    before = drive.state.estimates.copy()
    drive.window = np.concatenate([drive.window[4:], np.repeat(drive.window[-1:], 3, axis=0), drive.window[-1:]])
    drive.state, _ = drive.check.next(drive.state, drive.window, LENGTH, drive.window[-1, :4], skipped=3)
    np.testing.assert_array_equal(drive.state.estimates[: LENGTH - 4], before[4:])
    np.testing.assert_array_equal(drive.state.estimates[LENGTH - 4 : -1], np.tile(before[-1], (3, 1)))


def test_an_estimator_that_fails_shuts_the_jets() -> None:
    class Failing:
        def estimates(self, window: Array) -> Array:
            raise ControllerError("no")

    drive = sound()
    before = drive.state.estimates
    drive.check = replace(drive.check, estimator=Failing())
    drive.step()
    assert drive.fault is Reason.INTERNAL
    np.testing.assert_array_equal(drive.state.estimates[:-1], before[1:])  # a row for each of the window's


RELEASE = bundle.load(BUNDLE)
QUANTUM = 0.1 / 375.0  # of the wire, in Cp


@pytest.fixture(scope="module")
def pressures() -> np.ndarray:
    """Cp of the uncontrolled wake, (n, 4): the controller here leaves the jets shut, so that they fit."""
    (episode,) = [item for item in dataset.read(recording()).episodes if item.name == "none_0"]
    return episode.series["Cp"][:, sensors.TRUCK.indices(RELEASE.manifest.sensors)]


def started(bundle: Bundle = RELEASE, **settings: Any) -> Any:
    # A controller that leaves the jets shut helps nobody.
    unchecked = BenefitCheckConfig(enabled=False)
    return make_bench(RecordingController(lambda i: 0.0), bundle=bundle, benefit_check=unchecked, **settings)


def drive(bench: Any, pressures, steps, read=lambda cp, k: cp, *, enable=True):
    """Steps from where the bench stands in the recording; the commands."""
    rows = range(bench.frames_sent, bench.frames_sent + steps)
    return [bench.step(bench.pressure(read(pressures[k].copy(), k), enable=enable)) for k in rows]


def dead(j):
    return with_value(j, lambda value, k: 0.0)


@each("j", (1, 2))
def test_control_goes_on_without_a_dead_sensor_and_the_status_names_it_until_a_restart(pressures, j):
    bench = started()
    drive(bench, pressures, 80)
    assert {command.mode for command in drive(bench, pressures, 60, dead(j))} == {Mode.CONTROL}
    assert (bench.status.set_aside, bench.status.reason) == (1 << j, Reason.NONE)
    # The controller sees the estimate, in all rows, also in those from before the fault was noticed.
    window = bench.controller.calls[-1][0]
    seen = pressures[bench.frames_sent - len(window) : bench.frames_sent]
    true = seen[:, j]
    assert np.sqrt(np.mean(np.square(window[:, j] - true))) < 0.25 * true.std()
    others = [i for i in range(4) if i != j]
    np.testing.assert_allclose(window[:, others], seen[:, others], atol=QUANTUM)
    if j == 1:
        # It reads well again, and control is requested again.
        drive(bench, pressures, 20)
        drive(bench, pressures, 5, enable=False)
        drive(bench, pressures, 20)
        assert bench.status.set_aside == 0b10
        bench.ecu.restore(started().ecu.state)
        drive(bench, pressures, 40)
        assert bench.status.set_aside == 0


def test_two_sensors_that_drift_together_slowly_latch(pressures):
    """To 2.5 deviations in 250 periods: no single sensor explains it, and at no time do they disagree much. An
    estimator that knows no gusts saw 1.8; 2.2 pass unseen now, since a gust moves sensors together as well."""
    bench = started()
    drive(bench, pressures, 150)

    def read(cp, k):
        return cp + 0.128 * min(2.5, 0.01 * (k - 150)) * np.array([1, 1, 0, 0])

    assert Mode.FAULT in (drive(bench, pressures, 1, read)[0].mode for _ in range(400))
    assert (bench.status.reason, bench.status.set_aside) == (Reason.IMPLAUSIBLE, 0)


def test_switched_off_or_without_an_estimator_nothing_is_checked(pressures):
    off = replace(make_bench().config.ecu.sensor_check, enabled=False)
    bare = replace(RELEASE, manifest=replace(RELEASE.manifest, sensor_estimator=None), files={})
    for made, settings in ((RELEASE, {"sensor_check": off}), (bare, {})):
        bench = started(made, **settings)
        drive(bench, pressures, 80)
        drive(bench, pressures, 60, dead(1))
        assert (bench.status.set_aside, bench.controller.calls[-1][0][-1, 1]) == (0, 0.0)
