"""The drag and lift for a log without forces: values of a table, interpolated to the times of the log's rows."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from contract.arrays import Array
from contract.errors import DatasetError
from contract.recording.episode import ForcesClock
from contract.recording.importing.source_file import SUFFIXES, Reference, factor, read_columns, seconds_in, split_unit

FORCE_COLUMNS: Final = ("Cd", "Cl")


@dataclass(frozen=True, kw_only=True, eq=False)
class ForcesTable:
    """The forces of a table as time series: increasing times (n,), and `values` by the names in `FORCE_COLUMNS`, (n,)
    each. `names` has the names in the file, by the names "t", "Cd" and "Cl". `clock` is the clock of the times, if
    their unit determines it. Raises DatasetError for times that do not increase."""

    path: Path
    names: Mapping[str, str]
    t: Array
    values: Mapping[str, Array]
    clock: ForcesClock | None = None

    def __post_init__(self) -> None:
        first = self.names[FORCE_COLUMNS[0]]
        if len(self.t) < 2:
            raise DatasetError(f"{self.path}: {first!r} has {len(self.t)} rows, must have at least two")
        if (np.diff(self.t) <= 0).any():
            k = int(np.flatnonzero(np.diff(self.t) <= 0)[0])
            raise DatasetError(
                f"{self.path}: the times of {first!r} do not rise from row {k} to {k + 1}: "
                f"{self.t[k]:.15g}, {self.t[k + 1]:.15g}"
            )

    def at(self, times: Array, *, longest_gap: float, slack: float) -> dict[str, Array]:
        """Interpolate the forces linearly at m increasing times, (m,), which may be up to `slack` outside the rows,
        because clocks differ. Raises DatasetError for a time farther outside or in a gap longer than `longest_gap`."""
        first = self.names[FORCE_COLUMNS[0]]
        if times[0] < self.t[0] - slack or times[-1] > self.t[-1] + slack:
            raise DatasetError(
                f"{self.path}: {first!r} has times from {self.t[0]:.15g} to {self.t[-1]:.15g} s on the log's clock, "
                f"but the log's rows have times from {times[0]:.15g} to {times[-1]:.15g} s: the forces must cover "
                f"these rows; see --forces-clock and --forces-shift"
            )
        times = np.clip(times, self.t[0], self.t[-1])
        behind = np.searchsorted(self.t, times, side="left")
        wide = (self.t[behind] - self.t[np.maximum(behind - 1, 0)] > longest_gap) & (self.t[behind] != times)
        if wide.any():
            k = int(behind[np.flatnonzero(wide)[0]])
            raise DatasetError(
                f"{self.path}: {first!r} has no value between {self.t[k - 1]:.15g} and {self.t[k]:.15g} s on the "
                f"log's clock; rows must be no more than {longest_gap:.4g} s apart"
            )
        return {name: np.interp(times, self.t, values) for name, values in self.values.items()}


def read_forces(
    path: Path, renamed: Mapping[str, str], references: Mapping[str, Reference] | None = None
) -> ForcesTable:
    """Read t, Cd and Cl from a table or a file of arrays. `renamed` has their names in the file. An array that is not
    renamed may have its unit in brackets after the name, as `stillwake report` writes it. `references` has the values
    in the file that equal 1 in the data set, by series. Raises DatasetError if the file cannot be read, or if t, Cd and
    Cl are not all present or do not fit each other."""
    if not path.is_file():
        raise DatasetError(f"{path}: no such file")
    if path.suffix.lower() not in SUFFIXES:
        raise DatasetError(f"{path}: a table of forces must end in {', '.join(SUFFIXES)}")
    table = read_columns(path)
    inside = _inside(path, tuple(table), renamed)
    arrays = {name: table[there].numbers(path, there) for name, there in inside.items()}
    units = {name: table[there].unit or split_unit(there)[1] for name, there in inside.items()}
    t = arrays["t"] * seconds_in(path, inside["t"], units["t"])
    scales = {
        name: factor(path, name, inside[name], units[name], (references or {}).get(name)) for name in FORCE_COLUMNS
    }
    for name in FORCE_COLUMNS:
        if len(arrays[name]) != len(t):
            raise DatasetError(f"{path}: {inside[name]!r} has {len(arrays[name])} rows; {inside['t']!r} has {len(t)}")
    return ForcesTable(
        path=path,
        names=inside,
        t=t,
        values={name: arrays[name] * scale for name, scale in scales.items()},
        clock="t_c" if units["t"] in ("t_c", "W/U_inf") else None,
    )


def _inside(path: Path, there: tuple[str, ...], renamed: Mapping[str, str]) -> dict[str, str]:
    found = {}
    for name in ("t", *FORCE_COLUMNS):
        wanted = renamed.get(name, name)
        candidates = [one for one in there if one == wanted] or [one for one in there if split_unit(one)[0] == wanted]
        if len(candidates) != 1:
            raise DatasetError(
                f"{path}: no column {wanted!r} for the forces' table; the file has {', '.join(there[:12])}"
                f"{', ..' if len(there) > 12 else ''}. Give the column's name with --map {name}=NAME"
            )
        found[name] = candidates[0]
    return found
