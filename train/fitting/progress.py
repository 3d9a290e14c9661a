"""The phases of a training, and the reports of its progress."""

import time
from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import Any


class Phase(StrEnum):
    """The phases of a training, in order. A phase's checkpoint file is called by its value and `.pt`."""

    label: str
    """Name of the phase in messages."""

    FIT = "fit", "joint fit"
    FINISH = "finish", "longer unroll"
    RANK = "rank", "SHAP ranking"
    SELECT = "select", "sensor selection"
    STREAM = "stream", "distil, streamed"
    DISTIL = "distil", "distil, windows"
    LESSONS = "lessons", "roll out the teacher"
    PREDICTOR = "predictor", "distil predictor"
    REFINE = "refine", "through the flow"
    REST = "rest", "wake without jets"
    AIR_SPEED = "air_speed", "wrong speeds"

    def __new__(cls, value: str, label: str) -> "Phase":
        phase = str.__new__(cls, value)
        phase._value_ = value
        phase.label = label
        return phase


Progress = Callable[[Phase, int, int, Mapping[str, float]], None]
"""A function that receives the phase, the numbers of finished steps and of all steps, and the latest loss terms."""


def silent(*_: object) -> None:
    """Ignore the progress."""


class Stopwatch:
    """A `Progress` function that adds up the process's CPU time and the elapsed time for each phase. The time between
    two calls belongs to the phase of the later call."""

    def __init__(self) -> None:
        self._last = time.process_time(), time.monotonic()
        self._spent: dict[Phase, tuple[int, float, float]] = {}

    def __call__(self, phase: Phase, step: int, total: int, terms: Mapping[str, float]) -> None:
        del total, terms
        cpu_s, wall_s = now = time.process_time(), time.monotonic()
        _, cpu_before, wall_before = self._spent.get(phase, (0, 0.0, 0.0))
        self._spent[phase] = step, cpu_before + cpu_s - self._last[0], wall_before + wall_s - self._last[1]
        self._last = now

    def figures(self) -> list[dict[str, Any]]:
        """Return one entry per phase: its name, number of steps, and CPU time and elapsed time in minutes."""
        return [
            {"phase": phase.label, "steps": steps, "cpu_min": cpu_s / 60.0, "min": wall_s / 60.0}
            for phase, (steps, cpu_s, wall_s) in self._spent.items()
        ]
