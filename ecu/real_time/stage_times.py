"""When each stage of each period happened: a table in memory that exists before the first period.

Times are CLOCK_MONOTONIC in ns, one clock for all processes of a computer, so that the tables of two nodes can be laid
side by side; counts stand in the same table. 0 where nothing happened.
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
"""Stands for a counter of the E2E header, which may be 0, where there was no frame."""
USUAL_PERIODS: Final = 180_000
"""Periods kept without a stated number: an hour at 20 ms."""


class EcuStage(IntEnum):
    """Columns of the ECU; the table names them in lower case."""

    PERIOD = 0
    """Number of the period, those left out counted."""
    SCHEDULED = 1
    WOKE = 2
    PRESSURE_COUNTER = 3
    """E2E counter of the newest Pressure frame that the step was given; NOTHING without one."""
    FRAME_ARRIVED = 4
    """That frame."""
    STEP_BEGAN = 5
    PLAN_BEGAN = 6
    PLAN_ENDED = 7
    STEP_ENDED = 8
    SENT = 9
    """Both frames were handed to the bus."""
    COLLECTIONS = 10
    """Garbage collections since the period before."""
    MINOR_FAULTS = 11
    """Page faults without reading, since the period before (getrusage); the next two likewise."""
    MAJOR_FAULTS = 12
    SWITCHES = 13
    """Times that the process lost the processor against its will."""


class VehicleStage(IntEnum):
    """Columns of the vehicle."""

    PERIOD = 0
    SCHEDULED = 1
    SAMPLED = 2
    SENT = 3
    PRESSURE_COUNTER = 4
    """E2E counter of the Pressure frame sent; NOTHING if none was."""
    COMMAND_ARRIVED = 5
    """The JetCommand of this period."""
    ECHOED_COUNTER = 6
    """The pressure counter in it; NOTHING without."""
    ACTUATED = 7


class StageTimes:
    """A table of one node. It has `periods` rows; when all are used, the oldest ones are used again."""

    def __init__(self, stages: type[IntEnum], periods: int = USUAL_PERIODS) -> None:
        if periods < 1:
            raise ValueError(f"periods = {periods}: must be at least 1")
        self._stages = stages
        self._blank = np.array([NOTHING if stage.name.endswith("COUNTER") else 0 for stage in stages], dtype=np.int64)
        # Written to once, so that no page of it is missing later.
        self._table = np.repeat(self._blank[np.newaxis], periods, axis=0)
        self._begun = 0
        self._row = self._table[0]

    def begin(self) -> None:
        """Go on to the next period."""
        self._row = self._table[self._begun % len(self._table)]
        self._row[:] = self._blank
        self._begun += 1

    def note(self, stage: IntEnum, value: int) -> None:
        """A time or a count of this period."""
        self._row[stage] = value

    def rows(self) -> NDArray[np.int64]:
        """Those begun, oldest first, at most as many as the table has: (rows, stages)."""
        if self._begun <= len(self._table):
            return self._table[: self._begun].copy()
        return np.roll(self._table, -(self._begun % len(self._table)), axis=0)

    def save(self, path: Path) -> None:
        """Write as .npz, whole or not at all: `columns`, the names, and `rows`. Raises StillwakeError if it cannot be
        written."""
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, columns=np.array([stage.name.lower() for stage in self._stages]), rows=self.rows())


def load(path: Path, stages: type[IntEnum]) -> NDArray[np.int64]:
    """The rows of a saved table, (rows, stages). Raises StillwakeError if it is no table of this node."""
    try:
        file = read_npz(path)
        columns, rows = file["columns"].tolist(), file["rows"]
    except (OSError, ValueError) as error:
        raise StillwakeError(f"{path}: no table of stage times ({error})") from error
    expected = [stage.name.lower() for stage in stages]
    if columns != expected or rows.dtype != np.int64 or rows.ndim != 2 or rows.shape[1] != len(expected):
        raise StillwakeError(f"{path}: no table of the columns {', '.join(expected)}")
    return rows


class PlanTimes:
    """When the latest control step of any of several controllers was made, each running in place of the one before.
    Both are 0 after `forget`."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Before a period in which there may be no control step."""
        self.began_ns = self.ended_ns = 0


class TimedController:
    """Wraps another one."""

    def __init__(self, controller: Controller, now_ns: Callable[[], int], times: PlanTimes | None = None) -> None:
        self._controller = controller
        self._now_ns = now_ns
        self.times = PlanTimes() if times is None else times

    def control_step(self, *given: Any, **named: Any) -> ControlStep:
        """The other's."""
        self.times.began_ns = self._now_ns()
        try:
            return self._controller.control_step(*given, **named)
        finally:
            self.times.ended_ns = self._now_ns()
