"""The rows of a drive in uninterrupted pieces. Short gaps are filled; at a long gap the drive is cut or rejected."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from can_bridge.drives.log_periods import SenderClock
from can_bridge.drives.vehicle_speed import Travel
from can_bridge.wire.messages import SENSORS
from contract.arrays import Array, Mask, runs
from contract.errors import DatasetError

SHORTEST_PIECE: Final = 16
"""Smallest number of rows of a piece. Fewer rows neither determine the sender's clock nor help to train a model."""
_SAME: Final = 1e-6
"""Distance in control periods by which a resampled row may lie outside a piece because of rounding."""
_SHOWN: Final = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """An uninterrupted part of a drive, with n rows.

    Attributes:
        first_row: number of the data set's control periods from the log's first pressure to row 0.
        time_s: time of each row in s on the log's clock, (n,).
        Cp: pressure coefficients, (n, 4), in the sensor order of the Pressure message.
        action: action commanded at each row in U_inf W, (n,).
        initial_action: action of the jets before row 0, in U_inf W.
    """

    first_row: int
    time_s: Array
    Cp: Array
    action: Array
    initial_action: float

    def __len__(self) -> int:
        return len(self.action)


class Cutter:
    """A collector of pieces. It also collects a line of text for each cut and for each gap that was filled or left out.

    Attributes:
        lines: lines of text, which state times in s after the log's first pressure.
        filled: number of rows with filled pressures, and number of rows with a filled action.
        ever_valid: whether each pressure was valid in at least one row, (4,).
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
        """Begin a new piece between two times in s, because the sender restarted or was silent for a long time."""
        periods = round((first_s - last_s) / self._period_s) - 1
        at = f"at {last_s - self._begin_s:.3f} s"
        if periods > self._fill:
            self._cut(f"no pressures for about {periods} control periods {at}", f"; --fill allows {self._fill}")
        else:
            why = "the sender restarted, or a clock was set"
            self._cut(f"the pressures' counter and the log's clock disagree {at}: {why}")

    def add(self, table: Array, clock: SenderClock, moves: Mask) -> None:
        """Cut the table of one `FrameStretch`, converted to coefficients, into pieces. The table is NaN in rows in
        which the vehicle does not move or its speed is unknown, and `moves` is False there."""
        present = np.isfinite(table)
        self.ever_valid |= present[:, :SENSORS].any(axis=0)
        whole = np.flatnonzero(present.all(axis=1))
        if not len(whole):
            self.lines.append(f"none of the {len(table) - 1} rows {self._at(clock, 1)} is complete: left out")
            return
        # Missing rows at both ends are no gaps, because the logger may start before the ECU or stop between two frames.
        head, tail = int(whole[0]), int(whole[-1]) + 1
        if len(table) - 1 > tail - head:
            self.lines.append(
                f"{self._at(clock, 1)}, {head - 1} rows before the first complete row and {len(table) - tail} rows "
                f"after the last are left out"
            )
        before = np.arange(tail) < head
        cut = before.copy()
        short: list[tuple[str, int, int]] = []
        told = set[str]()
        for name, columns in self._groups(present[head:tail]):
            for a, b in runs(np.any(~present[:tail, columns], axis=1) & ~before):
                what = name if moves[a:b].all() else "speed of a moving vehicle"
                where = f"no {what} for {b - a} control period{'s' * (b - a > 1)} {self._at(clock, a)}"
                if where in told:
                    continue
                told.add(where)
                if b - a > self._fill:
                    self._cut(where, f"; --fill allows {self._fill}")
                    cut[a:b] = True
                else:
                    short.append((where, a, b))
        lines = [where for where, a, b in short if not cut[a:b].all()]
        for line in (*lines[:_SHOWN], *([f"and {len(lines) - _SHOWN} more such gaps"] if lines[_SHOWN:] else ())):
            self.lines.append(f"{line}: filled")
        for a, b in runs(~cut):
            self._keep(table, a, b, clock)

    def _groups(self, present: Mask) -> list[tuple[str, list[int]]]:
        """Return named groups of columns. The columns of a group are always missing in the same rows."""
        sensors = list(range(SENSORS))
        groups: list[tuple[str, list[int]]] = [("pressures", sensors)]
        if (present[:, sensors].any(axis=1) != present[:, sensors].all(axis=1)).any():
            groups = [(f"valid pressure {self._sensors[i]}", [i]) for i in sensors]
        return [*groups, ("command", [SENSORS])]

    def _keep(self, table: Array, a: int, b: int, clock: SenderClock) -> None:
        """Fill the gaps in the rows from a up to, but not including, b, and append these rows as one piece."""
        # A gap of one column may end where another column is cut, and then has no neighbour from which to interpolate.
        # So a piece begins with a complete row. The jets' action before this row must be known, or else the jets must
        # be shut in this row; the action before it then counts as 0.
        whole = np.flatnonzero(np.isfinite(table[a:b]).all(axis=1)) + a
        action = table[:, -1]
        begins = whole[np.isfinite(action[whole - 1]) | (action[whole] == 0.0)]
        count = int(whole[-1]) + 1 - int(begins[0]) if len(begins) else 0
        if count < SHORTEST_PIECE:
            self.lines.append(f"a piece of {count} rows {self._at(clock, a)} is left out: too short")
            return
        begin = int(begins[0])
        rows = np.arange(count)
        part = table[begin : begin + count]
        missing = np.isnan(part)
        self.filled[0] += int(missing[:, :-1].any(axis=1).sum())
        self.filled[1] += int(missing[:, -1].sum())
        part = np.column_stack([np.interp(rows, rows[np.isfinite(one)], one[np.isfinite(one)]) for one in part.T])
        time_s = clock.start_s + clock.period_s * (begin - 1 + rows.astype(np.float64))
        self.pieces.append(
            Piece(
                first_row=round((time_s[0] - self._begin_s) / self._period_s),
                time_s=time_s,
                Cp=part[:, :-1],
                action=part[:, -1],
                initial_action=float(np.nan_to_num(action[begin - 1])),
            )
        )

    def _cut(self, what: str, why: str = "") -> None:
        if not self._split:
            raise DatasetError(f"{self._path}: {what}{why}; --split makes separate episodes of both parts")
        self.lines.append(f"{what}: cut there")

    def _at(self, clock: SenderClock, place: int) -> str:
        return f"at {max(0.0, clock.start_s + clock.period_s * (place - 1) - self._begin_s):.3f} s"


def resampled(piece: Piece, travel: Travel, period: float) -> Piece:
    """Return the piece with rows at equal distances travelled, `period` body lengths apart, as in the ECU's window.
    Pressures are interpolated linearly. In the period after a row, the jets move linearly from the action of the
    previous row to the action of this row (`contract.recording`)."""
    way = travel.at(np.append(piece.time_s, 2 * piece.time_s[-1] - piece.time_s[-2]))
    first = int(np.ceil(way[0] / period - _SAME))
    wanted = period * np.arange(first, int(way[-2] / period + _SAME) + 1, dtype=np.float64)
    reached = np.concatenate([[piece.initial_action], piece.action])
    return Piece(
        first_row=first,
        time_s=travel.time(wanted),
        Cp=np.column_stack([np.interp(wanted, way[:-1], column) for column in piece.Cp.T]),
        action=np.interp(wanted + period, way, reached),
        initial_action=float(np.interp(wanted[0], way, reached)),
    )
