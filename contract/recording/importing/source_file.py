"""One file of the user's, CSV, NPZ or HDF5, as arrays by the names that they have here."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np

from contract.arrays import Array
from contract.errors import DatasetError
from contract.npz import read_npz
from contract.recording.hdf5 import opened
from contract.recording.importing.csv_table import read_csv
from contract.sensor_layout import SensorLayout

SUFFIXES: Final = (".csv", ".tsv", ".txt", ".npz", ".h5", ".hdf5")
BINARY: Final = (".npz", ".h5", ".hdf5")
INITIAL_ACTION: Final = "initial_action"


@dataclass(frozen=True, kw_only=True)
class Contents:
    """What a file has.

    Attributes:
        arrays: by the names that they have here, with one "Cp" of shape (n, sensors) in the layout's order.
        unread: names in the file that no one asked for.
        renamed: the names here whose arrays have another one in the file.
    """

    arrays: dict[str, Array]
    unread: tuple[str, ...]
    renamed: frozenset[str]


def read_source(path: Path, layout: SensorLayout, names: Sequence[str], renamed: Mapping[str, str]) -> Contents:
    """The arrays among `names` that the file has, and the pressures. Raises DatasetError if the file cannot be read,
    lacks a renamed array, or an array is no series of numbers; the message names both.

    Args:
        names: of series that may be there, without Cp.
        renamed: by the name here (of a series, a sensor or Cp), the name in the file where it is another one.
    """
    if not path.is_file():
        raise DatasetError(f"{path}: no such file")
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise DatasetError(f"{path}: a data file must end in {', '.join(SUFFIXES)}")
    if suffix in BINARY:
        stored = stored_arrays(path)
    else:
        table = read_csv(path)
        renamed = _in_this_file(path, table.header, renamed)
        wanted = {name: renamed.get(name, name) for name in (*names, *layout.names)}
        columns = {name: table.numbers(inside) for name, inside in wanted.items() if inside in table.header}
        arrays = _with_pressures(path, columns, layout, renamed, table.header)
        unread = tuple(name for name in table.header if name not in wanted.values())
        return Contents(arrays=arrays, unread=unread, renamed=frozenset(renamed))
    renamed = _in_this_file(path, tuple(stored), renamed)
    found: dict[str, Array] = {}
    for name in (*names, "Cp", *layout.names):
        inside = renamed.get(name, name)
        if inside in stored:
            kind = {"columns": name == "Cp", "one": name == INITIAL_ACTION}
            found[name] = numbers_of(path, inside, stored[inside], **kind)
    asked = {renamed.get(name, name) for name in found}
    unread = tuple(name for name in stored if name not in asked)
    arrays = _with_pressures(path, found, layout, renamed, tuple(stored))
    return Contents(arrays=arrays, unread=unread, renamed=frozenset(renamed))


def _in_this_file(path: Path, there: Sequence[str], renamed: Mapping[str, str]) -> dict[str, str]:
    """The other names that this file has; one that it lacks is refused unless it has the name here: without both, a
    series such as t would be passed over."""
    for name, inside in renamed.items():
        if inside not in there and name not in there:
            raise DatasetError(
                f"{path}: no column {inside!r}, which --map {name}={inside} names; it has {_listed(there)}"
            )
    return {name: inside for name, inside in renamed.items() if inside in there}


def _with_pressures(
    path: Path, arrays: dict[str, Array], layout: SensorLayout, renamed: Mapping[str, str], there: Sequence[str]
) -> dict[str, Array]:
    """One Cp in place of an array a sensor; a Cp that is there already stays."""
    columns = [arrays.pop(name, None) for name in layout.names]
    if "Cp" in arrays:
        return arrays
    found = [column for column in columns if column is not None]
    if len(found) < len(layout):
        missing = next(name for name, column in zip(layout.names, columns, strict=True) if column is None)
        raise DatasetError(
            f"{path}: no column {renamed.get(missing, missing)!r} for the sensor {missing}; it has {_listed(there)}. "
            f"Name another with --map {missing}=NAME, or take the sensor out of the list of sensors"
        )
    lengths = {len(column) for column in found}
    if len(lengths) > 1:
        raise DatasetError(f"{path}: the sensors' arrays have different lengths: {sorted(lengths)}")
    return {**arrays, "Cp": np.column_stack(found)}


def stored_arrays(path: Path) -> dict[str, Any]:
    """All arrays of an NPZ or HDF5 file by their names, in HDF5 with their groups. Raises DatasetError if the file
    cannot be read."""
    return _read_npz(path) if path.suffix.lower() == ".npz" else _read_hdf5(path)


def numbers_of(path: Path, name: str, values: Any, *, columns: bool = False, one: bool = False) -> Array:
    """A stored array as a series (n,), which may be one row or one column, with columns as (n, sensors), or one number.
    Raises DatasetError if it holds no numbers, has another shape, or a number that is not finite."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise DatasetError(f"{path}: array {name!r} holds {array.dtype}, must hold numbers")
    array = array.astype(np.float64)
    if columns:
        if array.ndim != 2:
            raise DatasetError(f"{path}: array {name!r} has shape {array.shape}, must be (steps, sensors)")
    else:
        if array.size != 1 if one else array.ndim != 1 and array.size != max(array.shape, default=0):
            wanted = "one number" if one else "(steps,)"
            raise DatasetError(f"{path}: array {name!r} has shape {array.shape}, must be {wanted}")
        array = array.reshape(-1)
    if not np.isfinite(array).all():
        place = np.argwhere(~np.isfinite(array))[0]
        where = f"step {place[0]}" + (f", column {place[1]}" if columns else "")
        raise DatasetError(f"{path}: array {name!r} holds a value that is not finite, first at {where}")
    return array


def _read_npz(path: Path) -> dict[str, Any]:
    try:
        return read_npz(path)
    except (OSError, ValueError) as error:
        raise DatasetError(f"{path}: {error}") from error


def _read_hdf5(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = {}

    def keep(name: str, node: object) -> None:
        if isinstance(node, h5py.Dataset):
            found[name] = node[()]

    visit: Callable[[str, object], None] = keep
    try:
        with opened(path) as file:
            file.visititems(visit)
            if INITIAL_ACTION in file.attrs:
                found[INITIAL_ACTION] = file.attrs[INITIAL_ACTION]
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        raise DatasetError(f"{path}: damaged or not an HDF5 file ({_first_line(error)})") from error
    return found


def _first_line(error: Exception) -> str:
    return str(error).split("\n", 1)[0]


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 12 else f"{', '.join(names[:12])} and {len(names) - 12} more"
