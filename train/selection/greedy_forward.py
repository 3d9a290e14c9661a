"""Forward selection: the sensor that helps the ridge student most, given those chosen before it.

A distillation for every candidate would be as many trainings as there are sensors, for each sensor chosen;
`train.selection.ridge_student` stands in for them.
"""

from train.fitting.progress import Phase, Progress, silent
from train.selection.ridge_student import RidgeStudent


def select_greedy(student: RidgeStudent, count: int, *, progress: Progress = silent) -> tuple[int, ...]:
    """Indices of the chosen sensors, in the order they were added; of equal ones the first in the sensors' order."""
    chosen: tuple[int, ...] = ()
    for place in range(count):
        errors = {index: student.error((*chosen, index)) for index in range(student.sensors) if index not in chosen}
        best = min(errors, key=errors.__getitem__)
        chosen = (*chosen, best)
        progress(Phase.SELECT, place + 1, count, {"error": errors[best]})
    return chosen
