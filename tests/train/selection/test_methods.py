"""The selection methods, and the ridge student's error against numpy's least squares and in closed form."""

from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from contract import sensors
from contract.config.learning import SelectionMethod
from contract.errors import ConfigError, DatasetError
from contract.sensor_layout import SensorLayout
from train.networks.model import Encoder, WakeModel
from train.networks.samples import Rows
from train.selection import methods
from train.selection.methods import RIDGE, RidgeStudent, sample

WINDOW = 32


class Listener(nn.Module):
    """Latents are weighted sums of some columns at some ages: z = sum of w x, over (column, age, w) of each latent."""

    def __init__(self, *latents: tuple[tuple[str, int, float], ...]) -> None:
        super().__init__()
        self.window = WINDOW
        self.weight = torch.zeros(len(latents), WINDOW, sensors.COUNT + 1)
        for number, terms in enumerate(latents):
            for name, age, weight in terms:
                column = sensors.COUNT if name == "action" else sensors.NAMES.index(name)
                self.weight[number, WINDOW - 1 - age, column] = weight

    def encode_segments(self, segments: Tensor) -> Tensor:
        windows = segments.unfold(1, WINDOW, 1)  # (S, W, F, L)
        return torch.einsum("swfl,zlf->swz", windows, self.weight)


listener: Any = Listener
"""A teacher with all that the methods read of an encoder."""


def noise_rows(*lengths: int) -> Rows:
    """Episodes of white noise of unit variance in all columns."""
    total = sum(lengths)
    inputs = torch.randn(total, sensors.COUNT + 1, generator=torch.Generator().manual_seed(0))
    zeros, unit = torch.zeros(total), torch.ones(sensors.COUNT)
    return Rows(inputs=inputs, actions=zeros, forces=torch.zeros(total, 2), lengths=lengths, unit=unit)


@pytest.fixture
def encoder(small_config) -> Encoder:
    return WakeModel(90, small_config.model).encoder


def test_every_method_chooses_as_many_as_asked(encoder, rows, small_config):
    for method in set(get_args(SelectionMethod)) - {"shap"}:
        names = methods.select(encoder, rows, replace(small_config.train, selection=method, sensors=3))
        assert len(sensors.TRUCK.indices(names)) == 3, method  # refuses unknown and repeated names
    with pytest.raises(ConfigError, match=r"train\.sensors = 91: must be from 1 to 90"):
        methods.select(encoder, rows, replace(small_config.train, selection="qr", sensors=91))


HEARD = ("lower_35", "base_0", "upper_12")


@pytest.fixture(scope="module")
def student() -> RidgeStudent:
    """Of a teacher with two latents, which depends on three sensors; the first the most."""
    teacher = listener((("lower_35", 0, 2.0), ("base_0", 12, 1.0)), (("base_0", 4, -1.0), ("upper_12", 8, 0.7)))
    return RidgeStudent(teacher, noise_rows(3000), seed=0)


def test_greedy_finds_the_sensors_the_latents_are_made_of_the_weightiest_first(student):
    reports = []
    chosen = methods.select_greedy(student, 3, progress=lambda *now: reports.append(now))
    assert tuple(sensors.NAMES[index] for index in chosen) == HEARD
    assert student.error(chosen) < 1e-6
    # Squared weights: 4, 1 + 1 and 0.49 of 6.49; the samples' variances are unity to a few per cent.
    assert [terms["error"] for *_, terms in reports] == pytest.approx([2.49 / 6.49, 0.49 / 6.49, 0.0], abs=0.03)


def test_random_is_the_best_of_its_own_draws(student):
    drawn = methods.draw_choices(20, 12, seed=4, available=sensors.COUNT)
    assert all(len(set(chosen)) == 20 for chosen in drawn)
    assert len(set(drawn)) == 12
    found = methods.select_random(student, 20, draws=12, seed=4)
    assert found in drawn
    assert all(student.error(found) <= student.error(chosen) for chosen in drawn)
    # 20 of 90 hold lower_35, two thirds of the power, in 2 of 9 draws: the best of these does.
    assert sensors.NAMES.index("lower_35") in found


PEAKS = (12, 83, 55)
"""Sensor where each mode is largest."""


def rows_of(pressure: np.ndarray) -> Rows:
    inputs = torch.from_numpy(np.column_stack([pressure, np.zeros(len(pressure))]).astype(np.float32))
    return replace(noise_rows(len(inputs)), inputs=inputs)


def test_pivots_are_the_peaks_of_disjoint_modes():
    # Three modes on disjoint sensors, each largest at its peak, with amplitudes that do not correlate.
    modes = np.zeros((sensors.COUNT, 3))
    for number, peak in enumerate(PEAKS):
        modes[[peak - 1, peak, peak + 1], number] = 1.0, 2.0, 1.0
    t = 2 * np.pi * np.arange(400) / 400
    rows = rows_of(np.column_stack([3.0 * np.sin(t), 2.0 * np.cos(2 * t), np.sin(5 * t)]) @ modes.T)
    for count in (1, 2, 3):
        assert set(methods.select_qr(rows, count)) == set(PEAKS[:count])
    # Sensors 10 and 11 hear the same amplitude, 70 another at half the strength: QR takes one of the two, then 70.
    pressure = np.zeros((400, sensors.COUNT))
    pressure[:, 10] = pressure[:, 11] = np.sin(t)
    pressure[:, 70] = 0.5 * np.cos(t)
    first, second = methods.select_qr(rows_of(pressure), 2)
    assert {first, second} in ({10, 70}, {11, 70})


def test_the_choice_is_symmetric_and_grows_from_the_rear_corners():
    assert [sensors.NAMES[index] for index in methods.select_by_hand(4)] == ["upper_39", "lower_39", "base_0", "base_9"]
    for count in range(1, 91):
        chosen = methods.select_by_hand(count)
        assert len(set(chosen)) == count
        image = set(np.array(sensors.TRUCK.mirror)[list(chosen)].tolist())
        assert len(set(chosen) - image) == count % 2, count
        assert count % 2 == 0 or set(chosen) - image == {chosen[-1]}
    # Any symmetric body has a choice outward from its rear corners.
    names = ("nose", "roof", "floor", "top", "centre", "bottom")
    places = np.array([[0.0, 0.0], [0.8, 0.3], [0.8, -0.3], [1.0, 0.2], [1.0, 0.0], [1.0, -0.2]])
    layout = SensorLayout.of(names, places, base=(3, 4, 5))
    order = [names[index] for index in methods.select_by_hand(6, layout)]
    assert order == ["roof", "floor", "top", "bottom", "centre", "nose"]
    for base, symmetric, message in (((3, 4, 5), False, "needs mirror images"), ((), True, "needs base sensors")):
        with pytest.raises(ConfigError, match=f"'hand' {message}"):
            methods.select_by_hand(2, SensorLayout.of(names, places, base=base, symmetric=symmetric))


def test_the_error_is_that_of_numpy_s_least_squares():
    teacher = listener((("upper_03", 0, 1.0), ("action", 4, 0.5)), (("base_2", 8, 1.0), ("lower_10", 3, 1.0)))
    rows = noise_rows(500, 300)
    rows.inputs[:, 20] += 2.0  # an offset, which the student's intercept must take up
    student = RidgeStudent(teacher, rows, seed=3)
    (x, z), (judged_x, judged_z) = sample(teacher, rows, seed=3)
    chosen = [3, 20, 82]
    columns = np.concatenate([np.arange(8) + 8 * index for index in (*chosen, sensors.COUNT)])
    x, judged_x = x[:, columns], judged_x[:, columns]
    mean_x, mean_z = x.mean(axis=0), z.mean(axis=0)
    # Ridge as ordinary least squares on rows of sqrt(n lambda) I added below.
    below = np.sqrt(len(x) * RIDGE) * np.eye(len(columns))
    weights = np.linalg.lstsq(
        np.vstack([x - mean_x, below]), np.vstack([z - mean_z, np.zeros((len(columns), 2))]), rcond=None
    )[0]
    left = judged_z - mean_z - (judged_x - mean_x) @ weights
    expected = np.square(left).sum() / np.square(judged_z - mean_z).sum()
    assert 0.2 < expected < 0.9
    assert student.error(chosen) == pytest.approx(expected, rel=1e-9)


def test_noise_is_priced_as_known_in_closed_form():
    # Noise on the sensors is priced as if it had been drawn.
    teacher = listener((("upper_07", 12, 1.0), ("base_2", 12, 0.5)))
    clean = noise_rows(6000)
    unit = torch.full((90,), 1.0)
    unit[7] = 4.0
    rows = replace(clean, unit=unit)
    student = RidgeStudent(teacher, rows, seed=0, sensor_noise=0.5)
    chosen = (7, 82)
    # One sensor, one lag, unit variance: the best weight leaves noise / (1 + noise) of its power.
    left = (1.0 * 4.0 / (1 + 4.0) + 0.25 * 0.25 / (1 + 0.25)) / 1.25
    assert student.error(chosen) == pytest.approx(left, rel=0.05)
    assert RidgeStudent(teacher, rows, seed=0).error(chosen) < 0.01


def test_fitted_and_judged_windows_are_others_and_none_crosses_an_episode_s_end():
    rows = noise_rows(60, 50)
    rows.inputs[:, 0] = torch.arange(110.0)
    (x, _), (judged_x, _) = sample(listener((("action", 0, 1.0),)), rows, seed=1)
    newest, judged = set(x[:, 0].astype(int)), set(judged_x[:, 0].astype(int))
    assert not newest & judged
    assert newest | judged == {*range(31, 60), *range(91, 110)}


def test_too_few_windows_and_a_teacher_without_opinion_are_refused():
    teacher = listener((("upper_07", 0, 1.0),))
    with pytest.raises(DatasetError, match="5 windows: a regression and its test need at least 6"):
        RidgeStudent(teacher, noise_rows(36), seed=0)
    still = replace(noise_rows(60), inputs=torch.zeros(60, sensors.COUNT + 1))
    with pytest.raises(DatasetError, match="the same in all windows"):
        RidgeStudent(teacher, still, seed=0)
