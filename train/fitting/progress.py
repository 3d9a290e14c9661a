"""The progress reports of a running training."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol


class Phase(StrEnum):
    """The phases of a training, in order; a phase's value is also the name of its checkpoint file."""

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


class Progress(Protocol):
    """A function that receives the phase, the numbers of finished steps and of all steps, and the latest loss terms."""

    def __call__(self, phase: Phase, step: int, total: int, terms: Mapping[str, float]) -> None: ...


def silent(phase: Phase, step: int, total: int, terms: Mapping[str, float]) -> None:
    """Ignore the progress."""
    del phase, step, total, terms


@dataclass(kw_only=True)
class Spent:
    """The resources that a phase used in this process. `cpu_s` is the process's CPU time, `wall_s` the elapsed time."""

    steps: int = 0
    cpu_s: float = 0.0
    wall_s: float = 0.0


@dataclass(kw_only=True)
class Stopwatch:
    """A `Progress` function that adds up the time of every phase, in order. The time between two calls belongs to the
    phase of the later call. `cpu` and `wall` return the process's CPU time and the wall-clock time, in s."""

    cpu: Callable[[], float] = time.process_time
    wall: Callable[[], float] = time.monotonic
    spent: dict[Phase, Spent] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._last = self.cpu(), self.wall()

    def __call__(self, phase: Phase, step: int, total: int, terms: Mapping[str, float]) -> None:
        del total, terms
        now = self.cpu(), self.wall()
        one = self.spent.setdefault(phase, Spent())
        one.steps = step
        one.cpu_s += now[0] - self._last[0]
        one.wall_s += now[1] - self._last[1]
        self._last = now

    def figures(self) -> list[dict[str, Any]]:
        """Return one entry per phase: its name, number of steps, and CPU time and elapsed time in minutes."""
        return [
            {"phase": phase.label, "steps": one.steps, "cpu_min": one.cpu_s / 60.0, "min": one.wall_s / 60.0}
            for phase, one in self.spent.items()
        ]
