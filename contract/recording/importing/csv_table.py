"""Tables of comma-separated values, read so that an error names file, line and column."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from contract.arrays import Array
from contract.errors import DatasetError

_SEPARATORS: Final = ",;\t"


@dataclass(frozen=True, kw_only=True)
class CsvTable:
    """Text cells under a header.

    Attributes:
        path: of the file, for messages.
        header: names of the columns, all different.
        rows: cells of each row, as many as the header has.
        lines: line number of each row, from 1.
    """

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]

    def numbers(self, name: str) -> Array:
        """A column as numbers, (n,); raises DatasetError for the first cell that is not a finite number."""
        column = self.header.index(name)
        values = np.empty(len(self.rows))
        for k, row in enumerate(self.rows):
            try:
                values[k] = float(row[column])
            except ValueError as error:
                raise DatasetError(f"{self._cell(k, name)}: {row[column]!r} is not a number") from error
            if not np.isfinite(values[k]):
                raise DatasetError(f"{self._cell(k, name)}: {row[column]} is not finite")
        return values

    def texts(self, name: str) -> tuple[str, ...]:
        """A column as it stands."""
        column = self.header.index(name)
        return tuple(row[column] for row in self.rows)

    def _cell(self, row: int, name: str) -> str:
        return f"{self.path}: line {self.lines[row]}, column {name!r}"


def read_csv(path: Path) -> CsvTable:
    """Read a table: a header line, then rows; separated by commas, semicolons or tabs; empty lines are skipped.

    Raises:
        DatasetError: the file cannot be read as text, has no header or rows, or a row of another length.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DatasetError(f"{path}: is not a text file in UTF-8") from error
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror or error})") from error
    first = text.lstrip("\r\n").split("\n", 1)[0]
    reader = csv.reader(text.splitlines(), delimiter=max(_SEPARATORS, key=first.count), skipinitialspace=True)
    rows: list[tuple[str, ...]] = []
    lines: list[int] = []
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells):
                rows.append(tuple(cell.strip() for cell in cells))
                lines.append(reader.line_num)
    except csv.Error as error:
        raise DatasetError(f"{path}: line {reader.line_num}: {error}") from error
    if len(rows) < 2:
        raise DatasetError(f"{path}: must have a line with the names of the columns and at least one row below it")
    header = rows[0]
    for name in header:
        if header.count(name) > 1:
            raise DatasetError(f"{path}: line {lines[0]}: column {name!r} is there twice")
    for row, line in zip(rows[1:], lines[1:], strict=True):
        if len(row) != len(header):
            raise DatasetError(f"{path}: line {line}: {len(row)} values, the header has {len(header)} columns")
    return CsvTable(path=path, header=header, rows=tuple(rows[1:]), lines=tuple(lines[1:]))


def columns_of(table: CsvTable, wanted: Mapping[str, str]) -> dict[str, Array]:
    """Numbers of the wanted columns that are there.

    Args:
        wanted: by the name here, the column's name in the table.
    """
    return {name: table.numbers(column) for name, column in wanted.items() if column in table.header}
