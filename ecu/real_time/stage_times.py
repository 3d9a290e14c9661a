"""The time of each stage of each period, in a table in memory that exists before the first period.

Times are in ns of CLOCK_MONOTONIC, which all processes of a computer share, so that the tables of two nodes can be
compared. The table also has counts. A stage that did not happen has the time 0.
"""

from collections.abc import Callable
from enum import IntEnum
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from contract.atomic import replacing
from contract.controller.interface import Controller, ControlStep
from contract.errors import StillwakeError
from contract.npz import read_npz

NOTHING: Final = -1
"""Value of an E2E counter if there was no frame; 0 is a valid counter."""
USUAL_PERIODS: Final = 180_000
"""Default number of stored periods: an hour at 20 ms."""


class EcuStage(IntEnum):
    """The columns of the ECU's table; a saved table has their names in lower case."""

    PERIOD = 0
    """Number of the period; skipped periods are counted, too."""
    SCHEDULED = 1
    WOKE = 2
    PRESSURE_COUNTER = 3
    """E2E counter of the newest Pressure frame passed to the step; NOTHING if there was no frame."""
    FRAME_ARRIVED = 4
    """Time of arrival of the newest Pressure frame passed to the step."""
    STEP_BEGAN = 5
    PLAN_BEGAN = 6
    PLAN_ENDED = 7
    STEP_ENDED = 8
    SENT = 9
    """Time when both frames had been passed to the bus; 0 if the bus refused a frame."""
    COLLECTIONS = 10
    """Number of garbage collections since the previous period."""
    MINOR_FAULTS = 11
    """Number of page faults that needed no reading from a disk since the previous period (getrusage)."""
    MAJOR_FAULTS = 12
    """Number of page faults that needed reading from a disk since the previous period (getrusage)."""
    SWITCHES = 13
    """Number of times that this thread lost the processor involuntarily since the previous period."""


class VehicleStage(IntEnum):
    """The columns of the vehicle's table."""

    PERIOD = 0
    SCHEDULED = 1
    SAMPLED = 2
    SENT = 3
    PRESSURE_COUNTER = 4
    """E2E counter of the sent Pressure frame; NOTHING if none was sent."""
    COMMAND_ARRIVED = 5
    """Time of arrival of this period's JetCommand."""
    ECHOED_COUNTER = 6
    """Pressure counter in this period's JetCommand; NOTHING without a JetCommand."""
    ACTUATED = 7


class StageTimes:
    """The stage times of one node, in `periods` rows; when all rows are used, the oldest are overwritten."""

    def __init__(self, stages: type[IntEnum], periods: int = USUAL_PERIODS) -> None:
        self._stages = stages
        self._blank = np.array([NOTHING if stage.name.endswith("COUNTER") else 0 for stage in stages], dtype=np.int64)
        # Every page of memory is written once here, so that the system provides it before the first control period.
        self._table = np.repeat(self._blank[np.newaxis], periods, axis=0)
        self._begun, self._row = 0, self._table[0]

    def begin(self) -> None:
        """Begin the row of the next period."""
        self._row = self._table[self._begun % len(self._table)]
        self._row[:] = self._blank
        self._begun += 1

    def note(self, stage: IntEnum, value: int) -> None:
        """Store a time or a count of this period."""
        self._row[stage] = value

    def rows(self) -> NDArray[np.int64]:
        """Return the rows of all periods that are still in the table, oldest first, in the shape (rows, stages)."""
        if self._begun <= len(self._table):
            return self._table[: self._begun].copy()
        return np.roll(self._table, -(self._begun % len(self._table)), axis=0)

    def save(self, path: Path) -> None:
        """Write the stages' names as `columns`, and `rows`, to an .npz file. Raises StillwakeError on failure."""
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, columns=np.array(_columns(self._stages)), rows=self.rows())


def _columns(stages: type[IntEnum]) -> list[str]:
    return [stage.name.lower() for stage in stages]


def load(path: Path, stages: type[IntEnum]) -> NDArray[np.int64]:
    """Return a saved table's rows, shape (rows, stages). Raises StillwakeError if the file is not this node's table."""
    try:
        file = read_npz(path)
        columns, rows = file["columns"].tolist(), file["rows"]
    except (OSError, ValueError) as error:
        raise StillwakeError(f"{path}: not a table of stage times ({error})") from error
    expected = _columns(stages)
    if columns != expected or rows.dtype != np.int64 or rows.shape[1:] != (len(expected),):
        raise StillwakeError(f"{path}: not a table of the columns {', '.join(expected)}")
    return rows


class PlanTimes:
    """The start and end of the latest control step. Controllers that run one after another share one such object."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Set both times to 0; call this before a period, because a period may have no control step."""
        self.began_ns = self.ended_ns = 0


class TimedController:
    """A wrapper that records the start and the end of another controller's steps."""

    def __init__(self, controller: Controller, now_ns: Callable[[], int], times: PlanTimes | None = None) -> None:
        self._controller, self._now_ns = controller, now_ns
        self.times = PlanTimes() if times is None else times

    def control_step(self, *given: Any, **named: Any) -> ControlStep:
        """Do the wrapped controller's step and store the times of the step."""
        self.times.began_ns = self._now_ns()
        try:
            return self._controller.control_step(*given, **named)
        finally:
            self.times.ended_ns = self._now_ns()
