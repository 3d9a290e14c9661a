"""The best of some random choices: what a method must beat to have found anything."""

import numpy as np

from train.fitting.progress import Phase, Progress, silent
from train.selection.ridge_student import RidgeStudent


def draw_choices(count: int, draws: int, seed: int, available: int) -> list[tuple[int, ...]]:
    """That many choices of `count` of the available sensors, each without repetition and in the sensors' order."""
    generator = np.random.default_rng(seed)
    return [tuple(np.sort(generator.choice(available, count, replace=False)).tolist()) for _ in range(draws)]


def select_random(
    student: RidgeStudent, count: int, *, draws: int, seed: int, progress: Progress = silent
) -> tuple[int, ...]:
    """The draw of which the ridge student makes the smallest error."""
    best: tuple[int, ...] = ()
    least = np.inf
    for number, chosen in enumerate(draw_choices(count, draws, seed, student.sensors)):
        error = student.error(chosen)
        if error < least:
            best, least = chosen, error
        progress(Phase.SELECT, number + 1, draws, {"error": least})
    return best
