"""A reader of CSV tables, and of the table that lists the sensors. Errors state file, line and column."""

import csv
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from contract.arrays import Array
from contract.errors import ConfigError, DatasetError
from contract.recording.episode import UNITS
from contract.recording.importing.stored import DEFAULT_FILL, GAP, UNWRITTEN
from contract.sensor_layout import SensorLayout

_YES: Final = ("1", "yes", "true", "x")
_NO: Final = ("", "0", "no", "false")
_SEPARATORS: Final = ",;\t"
_DECIMAL_COMMA: Final = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")


@dataclass(frozen=True, kw_only=True)
class CsvColumn:
    """A column of a table, with the interface of `Stored`: the cells' texts, and the line number of each cell."""

    texts: tuple[str, ...]
    lines: tuple[int, ...]
    unit: None = None

    def numbers(self, path: Path, name: str, **_shape: bool) -> Array:
        """Return the numbers, (n,). Raises DatasetError for the first cell that is not a finite number."""
        values = np.empty(len(self.texts))
        for k, (line, text) in enumerate(zip(self.lines, self.texts, strict=True)):
            place = f"{path}: line {line}, column {name!r}"
            try:
                values[k] = _number(text)
            except ValueError as error:
                remedy = "" if text else GAP
                if _DECIMAL_COMMA.fullmatch(text):
                    remedy = f": write {text.replace(',', '.')}, with a decimal point"
                raise DatasetError(f"{place}: {text!r} is not a number{remedy}") from error
            if not np.isfinite(values[k]) or abs(values[k]) >= 0.99 * DEFAULT_FILL:
                reason = UNWRITTEN if np.isfinite(values[k]) else "is not finite"
                raise DatasetError(f"{place}: {text} {reason}{GAP}")
        return values


def read_csv(path: Path) -> dict[str, CsvColumn]:
    """Read a table as columns by name. The file has a header line, then rows; commas, semicolons or tabs separate the
    cells. Empty lines are skipped. Lines above the header that begin with # are comments. If numbers directly follow
    the comments, the last comment is the header, as in files of `numpy.savetxt`. Raises DatasetError if the file is no
    text, or has no header, no rows, or a row with more or fewer cells than the header."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DatasetError(f"{path}: is not a text file in UTF-8: save it as UTF-8") from error
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror or error})") from error
    content = _with_header(text.splitlines())
    first = next((line for line in content if line.strip()), "")
    reader = csv.reader(content, delimiter=max(_SEPARATORS, key=first.count), skipinitialspace=True)
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
    # A spreadsheet may leave separators after the last column, in the header or in the rows.
    width = len(rows[0])
    rows = [row[:width] if not any(row[width:]) else row for row in rows]
    rows = [row + ("",) * (width - len(row)) if not any(rows[0][len(row) :]) else row for row in rows]
    _check_header(path, lines[0], rows[0])
    header = tuple(name or _unnamed(k, rows[1:]) for k, name in enumerate(rows[0]))
    for name, count in Counter(header).items():
        if count > 1:
            hint = "; the first line must have the names of the columns" if _is_number(name) else ""
            raise DatasetError(f"{path}: line {lines[0]}: column {name!r} occurs twice{hint}")
    for row, line in zip(rows[1:], lines[1:], strict=True):
        if len(row) != len(header):
            raise DatasetError(f"{path}: line {line} has {len(row)} values, but the header has {len(header)} columns")
    columns = zip(header, zip(*rows[1:], strict=True), strict=True)
    return {name: CsvColumn(texts=texts, lines=tuple(lines[1:])) for name, texts in columns}


def _unnamed(column: int, rows: Sequence[tuple[str, ...]]) -> str:
    empty = not any(any(row[column : column + 1]) for row in rows)
    return f"column {column + 1}, which has no name" + (" and is empty" if empty else "")


def _with_header(content: list[str]) -> list[str]:
    """Return the lines with empty lines in place of comments; a comment that is the header remains."""
    comments = int("".join(content[:1]).startswith("sep="))  # a spreadsheet writes this line
    while comments < len(content) and (content[comments].startswith("#") or not content[comments].strip()):
        comments += 1
    kept = [""] * comments + content[comments:]
    heads = [k for k in range(comments) if content[k].strip()]
    if heads and comments < len(content) and _is_number(re.split(f"[{_SEPARATORS}]", content[comments])[0]):
        kept[heads[-1]] = content[heads[-1]].removeprefix("#").lstrip()
    return kept


def _number(cell: str) -> float:
    """Parse a number in the notation of tables. Raises ValueError for other text, including Python's notation 1_000."""
    return float(cell.replace("_", "?"))


def _is_number(cell: str) -> bool:
    try:
        _number(cell)
    except ValueError:
        return False
    return True


def _check_header(path: Path, line: int, header: tuple[str, ...]) -> None:
    """Refuse a first line without column names. A later error message would only say that a column is missing."""
    if all(map(_is_number, header)):
        raise DatasetError(f"{path}: line {line} holds numbers; the first line must have the names of the columns")
    if len(header) == 1 and len(header[0].split()) > 1:
        raise DatasetError(
            f"{path}: line {line}: columns must be separated by commas, semicolons or tabs; spaces do not separate them"
        )


def read_sensors(
    path: Path, *, symmetric: bool, told: Callable[[Path, str], None] = lambda path, note: None
) -> SensorLayout:
    """Read the sensors' layout, in the order of the file's rows. `symmetric` is that of `SensorLayout.of`. `told` is
    called with the names of unused columns, if any. Raises DatasetError if a column is missing or a cell does not fit;
    the message states file, line and column."""
    table = read_csv(path)
    for column in ("name", "x", "y"):
        if column not in table:
            raise DatasetError(
                f"{path}: no column {column!r}; the first line has {', '.join(table)}, but it must have name, x "
                f"and y, and may have base"
            )
    unused = tuple(name for name in table if name not in ("name", "x", "y", "base"))
    if unused:
        told(path, f"not used: {', '.join(unused)}; a position has only x and y")
    names, lines = table["name"].texts, table["name"].lines
    for line, name in zip(lines, names, strict=True):
        if name in UNITS or name == "initial_action":
            raise DatasetError(f"{path}: line {line}: a sensor cannot be called {name!r}, the name of a series")
    base: list[int] = []
    for k, cell in enumerate(table["base"].texts if "base" in table else ()):
        if cell.lower() not in (*_YES, *_NO):
            raise DatasetError(f"{path}: line {lines[k]}, column 'base': {cell!r} must be 0 or 1")
        base += [k] if cell.lower() in _YES else []
    positions = np.column_stack([table[axis].numbers(path, axis) for axis in "xy"])
    try:
        return SensorLayout.of(names, positions, base=base, symmetric=symmetric)
    except ConfigError as error:
        raise DatasetError(f"{path}: {error}") from error
