"""Rows of a drive cut into uninterrupted pieces: short gaps filled, long ones refused or cut, each with its time."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from can_bridge.drives.log_periods import Clock, Rows, filled, runs
from can_bridge.wire.messages import SENSORS
from contract.arrays import Array, Mask
from contract.errors import DatasetError

SHORTEST: Final = 16
"""Rows of a piece: fewer show neither the sender's clock nor anything to a model."""
_SHOWN: Final = 5
"""Filled gaps of one stretch that are listed one by one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """One uninterrupted part of a drive.

    Attributes:
        first_row: control periods from the log's first pressure to row 0.
        time_s: of each row on the log's clock, (n,).
        Cp: (n, 4), in the message's order.
        action: commanded at each row, (n,).
        initial_action: in force before row 0.
    """

    first_row: int
    time_s: Array
    Cp: Array
    action: Array
    initial_action: float

    def __len__(self) -> int:
        return len(self.action)


class Cutter:
    """Collects pieces, and a line for whatever was filled, cut or left out.

    Attributes:
        lines: in words; times are in s after the log's first pressure.
        filled: rows with filled pressures, rows with a filled action.
        ever_valid: whether each pressure was valid in any row, (4,).
    """

    def __init__(
        self, path: Path, fill: int, split: bool, sensors: Sequence[str], begin_s: float, period_s: float
    ) -> None:
        self.pieces: list[Piece] = []
        self.lines: list[str] = []
        self.filled = [0, 0]
        self.ever_valid = np.zeros(SENSORS, dtype=np.bool_)
        self._path, self._fill, self._split, self._sensors = path, fill, split, sensors
        self._begin_s, self._period_s = begin_s, period_s

    def restart(self, last_s: float, first_s: float) -> None:
        """The sender began again, or was heard again after long, between these times."""
        periods = round((first_s - last_s) / self._period_s) - 1
        at = f"at {last_s - self._begin_s:.3f} s"
        if periods > self._fill:
            self._cut(f"no pressures for about {periods} control periods {at}", f"; --fill allows {self._fill}")
        else:
            self._cut(
                f"the pressures' counter and the log's clock part {at}: the sender began again, or a clock was set"
            )

    def add(self, rows: Rows, clock: Clock) -> None:
        """Cut one stretch into pieces."""
        table = np.column_stack([rows.Cp, rows.action])
        present = np.isfinite(table)
        self.ever_valid |= present[:, :SENSORS].any(axis=0)
        cut = np.zeros(len(table), dtype=np.bool_)
        whole = np.flatnonzero(present.all(axis=1))
        if not len(whole):
            self.lines.append(f"{self._path}: {len(table)} rows {self._at(clock, 0)} have none that is whole: left out")
            return
        # What is missing at the ends is no gap: the log began before the ECU, or ended between two frames.
        head, tail = int(whole[0]), int(whole[-1]) + 1
        if len(table) > tail - head:
            self.lines.append(
                f"{self._path}: {self._at(clock, 0)}, {head} rows in front of the first whole one are left out, and "
                f"{len(table) - tail} behind the last"
            )
        short: list[str] = []
        for column in range(table.shape[1]):
            for a, b in runs(~present[head:tail, column]):
                if b - a > self._fill:
                    cut[head + a : head + b] = True
        for name, columns in self._groups(present[head:tail]):
            for a, b in runs(np.any(~present[head:tail, columns], axis=1)):
                where = f"no {name} for {b - a} control period{'s' * (b - a > 1)} {self._at(clock, head + a)}"
                if b - a > self._fill:
                    self._cut(where, f"; --fill allows {self._fill}")
                elif not cut[head + a : head + b].all():
                    short.append(where)
        self._list(short)
        for a, b in runs(~cut[head:tail]):
            self._keep(table, rows, head + a, head + b, clock)

    def _groups(self, present: Mask) -> list[tuple[str, list[int]]]:
        """Columns that are missing together, by what to call them."""
        sensors = list(range(SENSORS))
        together = ~(present[:, sensors].any(axis=1) ^ present[:, sensors].all(axis=1))
        groups: list[tuple[str, list[int]]] = [("pressures", sensors)]
        if not together.all():
            groups = [(f"valid pressure {self._sensors[i]}", [i]) for i in sensors]
        return [*groups, ("command", [SENSORS])]

    def _keep(self, table: Array, rows: Rows, a: int, b: int, clock: Clock) -> None:
        """One piece of the rows from a to b, its gaps filled."""
        # A gap of one column may end at a cut of another: without a neighbour there is no line to fill on.
        whole = np.flatnonzero(np.isfinite(table[a:b]).all(axis=1)) + a
        begin = next((k for k in whole.tolist() if self._before(table, rows, k) is not None), b)
        end = int(whole[-1]) + 1 if len(whole) else b
        initial = self._before(table, rows, begin) if begin < end else None
        if initial is None or end - begin < SHORTEST:
            rest = max(0, end - begin)
            self.lines.append(f"{self._path}: a piece of {rest} rows {self._at(clock, a)} is left out: too short")
            return
        a, b = begin, end
        part = table[a:b]
        self.filled[0] += int(np.isnan(part[:, :-1]).any(axis=1).sum())
        self.filled[1] += int(np.isnan(part[:, -1]).sum())
        part = np.column_stack([filled(column) for column in part.T])
        time_s = clock.start_s + clock.period_s * np.arange(a, b, dtype=np.float64)
        self.pieces.append(
            Piece(
                first_row=round((time_s[0] - self._begin_s) / self._period_s),
                time_s=time_s,
                Cp=part[:, :-1],
                action=part[:, -1],
                initial_action=initial,
            )
        )

    @staticmethod
    def _before(table: Array, rows: Rows, k: int) -> float | None:
        """The action in force before row k: known from the log, or 0 where the jets are shut in row k; else None."""
        before = float(table[k - 1, -1]) if k else (np.nan if rows.before is None else rows.before)
        if np.isfinite(before):
            return float(before)
        return 0.0 if table[k, -1] == 0.0 else None

    def _cut(self, what: str, why: str = "") -> None:
        if not self._split:
            raise DatasetError(f"{self._path}: {what}{why}; with --split both sides become episodes of their own")
        self.lines.append(f"{self._path}: {what}: cut there")

    def _list(self, short: list[str]) -> None:
        self.lines += [f"{self._path}: {one}: filled" for one in short[:_SHOWN]]
        if len(short) > _SHOWN:
            self.lines.append(f"{self._path}: and {len(short) - _SHOWN} more such gaps: filled")

    def _at(self, clock: Clock, row: int) -> str:
        return f"at {max(0.0, clock.start_s + clock.period_s * row - self._begin_s):.3f} s"
