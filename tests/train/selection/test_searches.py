"""Greedy selection and random draws, judged by a ridge student whose answers are known."""

import pytest

from contract import sensors
from train.selection.greedy_forward import select_greedy
from train.selection.random_draws import draw_choices, select_random
from train.selection.ridge_student import RidgeStudent, ridge_student

HEARD = ("lower_35", "base_0", "upper_12")


@pytest.fixture(scope="module")
def student(listener, noise_rows) -> RidgeStudent:
    """Of a teacher with two latents, which depends on three sensors; the first the most."""
    teacher = listener((("lower_35", 0, 2.0), ("base_0", 12, 1.0)), (("base_0", 4, -1.0), ("upper_12", 8, 0.7)))
    return ridge_student(teacher, noise_rows((3000,)), seed=0)


def test_greedy_finds_the_sensors_the_latents_are_made_of_the_weightiest_first(student):
    reports = []
    chosen = select_greedy(student, 3, progress=lambda *now: reports.append(now))
    assert tuple(sensors.NAMES[index] for index in chosen) == HEARD
    assert student.error(chosen) < 1e-6
    # Squared weights: 4, 1 + 1 and 0.49 of 6.49; the samples' variances are unity to a few per cent.
    assert [terms["error"] for *_, terms in reports] == pytest.approx([2.49 / 6.49, 0.49 / 6.49, 0.0], abs=0.03)


def test_random_is_the_best_of_its_own_draws(student):
    drawn = draw_choices(20, 12, seed=4, available=sensors.COUNT)
    assert all(len(set(chosen)) == 20 for chosen in drawn)
    assert len(set(drawn)) == 12
    found = select_random(student, 20, draws=12, seed=4)
    assert found in drawn
    assert all(student.error(found) <= student.error(chosen) for chosen in drawn)
    # 20 of 90 hold lower_35, two thirds of the power, in 2 of 9 draws: the best of these does.
    assert sensors.NAMES.index("lower_35") in found
