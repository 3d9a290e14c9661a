"""The ridge student's error against numpy's least squares and against errors known in closed form."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from contract import sensors
from contract.errors import DatasetError
from train.networks.samples import Rows
from train.selection.methods import RIDGE, ridge_student, sample


def test_the_error_is_that_of_numpy_s_least_squares(listener, noise_rows):
    teacher = listener((("upper_03", 0, 1.0), ("action", 4, 0.5)), (("base_2", 8, 1.0), ("lower_10", 3, 1.0)))
    rows = noise_rows((500, 300))
    rows.inputs[:, 20] += 2.0  # an offset, which the student's intercept must take up
    student = ridge_student(teacher, rows, seed=3)
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


def test_noise_is_priced_as_known_in_closed_form(listener, noise_rows):
    # Noise on the sensors is priced as if it had been drawn.
    teacher = listener((("upper_07", 12, 1.0), ("base_2", 12, 0.5)))
    clean = noise_rows((6000,))
    unit = torch.full((90,), 1.0)
    unit[7] = 4.0
    rows = replace(clean, unit=unit)
    student = ridge_student(teacher, rows, seed=0, sensor_noise=0.5)
    chosen = (7, 82)
    # One sensor, one lag, unit variance: the best weight leaves noise / (1 + noise) of its power.
    left = (1.0 * 4.0 / (1 + 4.0) + 0.25 * 0.25 / (1 + 0.25)) / 1.25
    assert student.error(chosen) == pytest.approx(left, rel=0.05)
    assert ridge_student(teacher, rows, seed=0).error(chosen) < 0.01


def test_fitted_and_judged_windows_are_others_and_none_crosses_an_episode_s_end(listener, noise_rows):
    rows = noise_rows((60, 50))
    rows.inputs[:, 0] = torch.arange(110.0)
    (x, _), (judged_x, _) = sample(listener((("action", 0, 1.0),)), rows, seed=1)
    newest, judged = set(x[:, 0].astype(int)), set(judged_x[:, 0].astype(int))
    assert not newest & judged
    assert newest | judged == {*range(31, 60), *range(91, 110)}


def test_too_few_windows_and_a_teacher_without_opinion_are_refused(listener, noise_rows):
    teacher = listener((("upper_07", 0, 1.0),))
    with pytest.raises(DatasetError, match="5 windows, too few to fit and judge a student: must be at least 6"):
        ridge_student(teacher, noise_rows((36,)), seed=0)
    still = noise_rows((60,))
    still = Rows(inputs=torch.zeros_like(still.inputs), actions=still.actions, forces=still.forces, lengths=(60,))
    with pytest.raises(DatasetError, match="the same in all windows"):
        ridge_student(teacher, still, seed=0)
