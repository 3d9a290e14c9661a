"""What a training reports while it runs."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Protocol


class Phase(StrEnum):
    """The phases of a training, in order; a value also names the phase's checkpoint file."""

    label: str
    """For people."""

    FIT = "fit", "joint fit"
    FINISH = "finish", "longer unroll"
    RANK = "rank", "SHAP ranking"
    SELECT = "select", "sensor selection"
    STREAM = "stream", "distil, streamed"
    DISTIL = "distil", "distil, windows"
    LESSONS = "lessons", "roll out the teacher"
    PREDICTOR = "predictor", "distil predictor"

    def __new__(cls, value: str, label: str) -> "Phase":
        phase = str.__new__(cls, value)
        phase._value_ = value
        phase.label = label
        return phase


class Progress(Protocol):
    """Called with the phase, steps done, steps in all and the latest loss terms."""

    def __call__(self, phase: Phase, step: int, total: int, terms: Mapping[str, float]) -> None: ...


def silent(phase: Phase, step: int, total: int, terms: Mapping[str, float]) -> None:
    """A Progress that does nothing."""
    del phase, step, total, terms
