"""What a loop that does nothing met in the same run: how late it woke, and what the machine kept from the others."""

from dataclasses import dataclass, field, replace
from enum import IntEnum
from pathlib import Path
from typing import Self

import numpy as np

from contract.arrays import Array
from contract.atomic import replacing
from contract.errors import StillwakeError
from firmware_sim.latency.stages import Times


class IdleStage(IntEnum):
    """Columns; times are CLOCK_MONOTONIC in ns. The last three are sums since the row before."""

    PERIOD = 0
    """Number of the period, those left out counted."""
    SCHEDULED = 1
    WOKE = 2
    ECU_WAITED = 3
    """Time in which the ECU's threads that have to be on time were ready and had no processor (schedstat), ns."""
    VEHICLE_WAITED = 4
    STOLEN = 5
    """Time that the host of a virtual machine kept from all of its processors (/proc/stat), ns."""


@dataclass(frozen=True, kw_only=True, eq=False)
class IdleTimes:
    """The idle loop's table.

    Attributes:
        rows: of `IdleStage`, (m, stages).
        knows_waiting: whether this system tells how long a thread waited for a processor.
        elsewhere: rows of further idle loops, each tied to one processor: a virtual machine's may stand still one by
            one; (l, stages).
    """

    rows: Times
    knows_waiting: bool
    elsewhere: Times = field(default_factory=lambda: np.empty((0, len(IdleStage)), dtype=np.int64))

    def late(self, period_ns: int) -> Array:
        """From each scheduled instant to waking up, ns; a period that was left out counts until the next waking."""
        scheduled, woke = self.rows[:, IdleStage.SCHEDULED], self.rows[:, IdleStage.WOKE]
        numbers = np.arange(self.rows[0, IdleStage.PERIOD], self.rows[-1, IdleStage.PERIOD] + 1)
        row = np.searchsorted(self.rows[:, IdleStage.PERIOD], numbers)
        before = self.rows[row, IdleStage.PERIOD] - numbers
        late: Array = (woke[row] - scheduled[row] + before * period_ns).astype(float)
        return late

    def between(self, begin_ns: int, end_ns: int) -> Self:
        """Of the periods scheduled from one instant to another."""
        scheduled = self.rows[:, IdleStage.SCHEDULED]
        inside = (scheduled >= begin_ns) & (scheduled <= end_ns)
        return replace(self, rows=self.rows[inside])

    def save(self, path: Path) -> None:
        """As .npz, whole or not at all; raises StillwakeError."""
        columns = np.array([stage.name.lower() for stage in IdleStage])
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, columns=columns, rows=self.rows, knows_waiting=np.array(self.knows_waiting))

    @classmethod
    def load(cls, path: Path) -> Self:
        """What `save` wrote; raises StillwakeError if it is not that."""
        expected = [stage.name.lower() for stage in IdleStage]
        try:
            with np.load(path, allow_pickle=False) as file:
                columns, rows, knows = file["columns"].tolist(), np.asarray(file["rows"]), bool(file["knows_waiting"])
        except (OSError, ValueError, KeyError, EOFError, TypeError) as error:
            raise StillwakeError(f"{path}: no table of an idle loop ({error})") from error
        if columns != expected or rows.dtype != np.int64 or rows.ndim != 2 or rows.shape[1] != len(expected):
            raise StillwakeError(f"{path}: no table of the columns {', '.join(expected)}")
        return cls(rows=rows, knows_waiting=knows)
