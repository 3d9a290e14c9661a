"""The sensors' names and places, from a CSV file with the columns name, x, y and, if one likes, base."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from contract.errors import ConfigError, DatasetError
from contract.recording.episode import UNITS
from contract.recording.importing.csv_table import read_csv
from contract.sensor_layout import SensorLayout

_YES: Final = ("1", "yes", "true", "x")
_NO: Final = ("", "0", "no", "false")
_RESERVED: Final = frozenset({*UNITS, "initial_action"})


def read_sensors(
    path: Path, *, symmetric: bool, told: Callable[[Path, str], None] = lambda path, note: None
) -> SensorLayout:
    """The layout, in the order of the file's rows. Raises DatasetError if a column is missing, or a cell does not fit;
    the message names file, line and column. `symmetric` states whether body and jets are their own mirror images in y =
    0; the sensors' images follow from their places, if every sensor has one. `told` is called with the columns that
    are not used, if there are any."""
    table = read_csv(path)
    for column in ("name", "x", "y"):
        if column not in table.header:
            raise DatasetError(
                f"{path}: no column {column!r}; the first line has {', '.join(table.header)}, it must have name, x, y "
                f"and may have base"
            )
    unused = tuple(name for name in table.header if name not in ("name", "x", "y", "base"))
    if unused:
        told(path, f"not used: {', '.join(unused)}; a place is x and y alone")
    names = table.texts("name")
    for line, name in zip(table.lines, names, strict=True):
        if name in _RESERVED:
            raise DatasetError(f"{path}: line {line}: a sensor cannot be called {name!r}, the name of a series")
    base: list[int] = []
    for k, cell in enumerate(table.texts("base") if "base" in table.header else ()):
        if cell.lower() not in (*_YES, *_NO):
            raise DatasetError(f"{path}: line {table.lines[k]}, column 'base': {cell!r} must be 0 or 1")
        base += [k] if cell.lower() in _YES else []
    try:
        return SensorLayout.of(
            names, np.column_stack([table.numbers("x"), table.numbers("y")]), base=base, symmetric=symmetric
        )
    except ConfigError as error:
        raise DatasetError(f"{path}: {error}") from error
