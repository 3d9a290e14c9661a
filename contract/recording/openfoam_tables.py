"""A reader of the time tables of OpenFOAM's function objects. It joins the tables that restarts of a case write."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from contract.arrays import Array

_SAME = 1e-6
"""Largest difference between two times that were rounded from the same instant."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FoamTable:
    """A table of OpenFOAM. `header` has the comment lines, without #. `rows` (n, columns) has the time and the values
    of each row; brackets of vectors are ignored. `files` are the files with these rows, in order."""

    header: tuple[str, ...]
    rows: Array
    files: tuple[Path, ...]


def read_foam_table(folder: Path, file: str, *, cut_off: bool = False) -> FoamTable | None:
    """Read the table whose file name matches the regular expression `file` in a function object's folder; None if there
    is no such file. The folder has a subfolder for every start of the case. From the time of a start on, its rows
    replace the rows of earlier starts. With `cut_off`, an incomplete last line, as in a running case, is ignored.
    Raises OSError, or ValueError that states file and line."""
    starts = sorted((start, len(path.name), path) for path, start in _starts(folder, file))
    header: tuple[str, ...] = ()
    rows: list[Array] = []
    for start, _, path in starts:
        lines, newer = _read(path, cut_off)
        if header and [line.split() for line in lines] != [line.split() for line in header]:
            raise ValueError(f"{path}: its header differs from that of {starts[0][2]}")
        if rows and newer and len(newer[0]) != len(rows[0]):
            raise ValueError(f"{path} has {len(newer[0])} columns, but {starts[0][2]} has {len(rows[0])}")
        header = header or lines
        first = newer[0][0] if newer else np.inf
        rows = [row for row in rows if row[0] <= start + _SAME and row[0] < first - _SAME] + newer
    return FoamTable(header=header, rows=np.array(rows), files=tuple(path for *_, path in starts)) if rows else None


def _starts(folder: Path, file: str) -> list[tuple[Path, float]]:
    found = []
    for path in folder.glob("*/*"):
        if re.fullmatch(file, path.name) and path.is_file():
            try:
                found.append((path, float(path.parent.name)))
            except ValueError:
                continue  # the folder's name is no time, so it is a user's copy
    return found


def _read(path: Path, cut_off: bool) -> tuple[tuple[str, ...], list[Array]]:
    content = path.read_bytes()
    if cut_off:
        content = content[: content.rfind(b"\n") + 1]
    header: list[str] = []
    rows: list[Array] = []
    for number, line in enumerate(content.splitlines(), 1):
        if line.lstrip().startswith(b"#"):
            header.append(line.decode("utf-8", "replace").strip()[1:])
        elif line.strip():
            try:
                rows.append(np.array(line.translate(None, b"()").split(), dtype=np.float64))
            except ValueError as error:
                raise ValueError(f"{path}: line {number}: {error}") from error
            if len(rows[-1]) != len(rows[0]):
                raise ValueError(f"{path}: line {number} has {len(rows[-1])} values: must have {len(rows[0])}")
    return tuple(header), rows
