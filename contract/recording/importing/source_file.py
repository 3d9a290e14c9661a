"""A reader of a user's file. It returns arrays with the data set's names, and converts units with reference values."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from contract.arrays import Array
from contract.errors import ConfigError, DatasetError
from contract.recording.importing.csv_table import CsvColumn, read_csv
from contract.recording.importing.stored import BINARY, INITIAL_ACTION, Stored, stored_arrays
from contract.sensor_layout import SensorLayout

SUFFIXES: Final = (".csv", ".tsv", ".txt", *BINARY)
_KNOWN: Final[Mapping[str, tuple[str, float]]] = {
    name: (base, size)
    for base, size, names in (
        ("1", 1.0, "|1|-|none|dimensionless|W/U_inf|t_c|U_inf|U_inf W|rho U_inf^3 W / 2"),
        ("1", 0.01, "%|percent"),
        ("s", 1.0, "s|sec|second|seconds"),
        ("s", 1e-3, "ms|msec|millisecond|milliseconds"),
        ("s", 1e-6, "us|µs|μs|microseconds"),  # micro sign and Greek mu
        ("s", 60.0, "min|minutes"),
        ("s", 3600.0, "h|hours"),
        ("Pa", 1.0, "Pa|pascal|N/m2|N m-2"),
        ("Pa", 100.0, "hPa|mbar|millibar"),
        ("Pa", 1e3, "kPa"),
        ("Pa", 1e5, "bar"),
        ("Pa", 6894.757293168, "psi"),
        ("m2/s2", 1.0, "m2/s2|m2 s-2"),
        ("N", 1.0, "N"),
        ("N", 1e3, "kN"),
        ("N", 1e-3, "mN"),
        ("N/m", 1.0, "N/m|N m-1"),
        ("m3/s", 1.0, "m3/s|m3 s-1"),
        ("m3/s", 1e-3, "l/s|L/s"),
        ("m2/s", 1.0, "m2/s|m2 s-1"),
    )
    for name in names.split("|")
}
"""Base unit of every known unit, and the unit's size in base units; the base unit "1" is dimensionless."""
_REMEDIES: Final = {
    "Pa": "give rho U_inf^2 / 2 as in --reference Cp=240Pa",
    "s": "give W / U_inf as in --reference t=5ms",
    "N": "give rho U_inf^2 / 2 times W and the span as in --reference {name}=40N",
}
_BEHIND: Final = re.compile(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")
_REFERENCE: Final = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)")


@dataclass(frozen=True, kw_only=True)
class Reference:
    """The value in the files that equals 1 in the data set, such as 40 N. Without a unit, the file's unit applies."""

    number: float
    unit: str | None
    option: str

    def __str__(self) -> str:
        return f"{self.number:g}{self.unit or ''}"


def references_of(texts: Sequence[str]) -> dict[str, Reference]:
    """Parse options --reference NAME=NUMBER[UNIT] into references by name. Raises ConfigError for other texts."""
    found: dict[str, Reference] = {}
    for text in texts:
        option = f"--reference {text}"
        name, _, value = (part.strip() for part in text.partition("="))
        parts = _REFERENCE.fullmatch(value)
        if not name or parts is None or not 0.0 < abs(float(parts[1])) < float("inf"):
            raise ConfigError(f"{option}: write NAME=NUMBER and a unit, such as Cd=40N or t=5ms; NUMBER must not be 0")
        if name in found:
            raise ConfigError(f"{option}: {name} already has the reference {found[name]}")
        found[name] = Reference(number=float(parts[1]), unit=parts[2] or None, option=option)
    return found


def split_unit(column: str) -> tuple[str, str | None]:
    """Split a column's header into the name and the unit, if a known unit follows the name in brackets."""
    parts = _BEHIND.fullmatch(column)
    if parts is None or parts[3] == "1":  # a number, as in "tap (1)"
        return column, None
    unit = parts[2] or parts[3] or ""
    return (parts[1], unit) if _plain(unit) in _KNOWN else (column, None)


def factor(path: Path, name: str, inside: str, unit: str | None, reference: Reference | None) -> float:
    """Return the factor that converts the numbers of a series or sensor to the data set's unit. `inside` and `unit` are
    the name and the unit in the file. Raises DatasetError for a dimension without a reference of this dimension."""
    base, size = _base(unit)
    if reference is None:
        if base != "1":
            general = "give the number in the file that means 1 as in --reference {name}=NUMBER"
            remedy = _REMEDIES.get(base, general).format(name=name)
            raise DatasetError(f"{path}: {inside!r} is in {unit!r}; {name} must be without dimension: {remedy}")
        return size
    if unit is None or reference.unit is None:
        return 1.0 / reference.number
    other, other_size = _base(reference.unit)
    if base != other:
        raise DatasetError(f"{path}: {inside!r} is in {unit!r} in the file, but {reference.option} is not")
    return size / (reference.number * other_size)


def seconds_in(path: Path, inside: str, unit: str | None) -> float:
    """Return the length of a unit of time in s; 1 if there is no unit. Raises DatasetError for another kind of unit."""
    base, size = _base(unit)
    if base not in ("1", "s"):
        raise DatasetError(f"{path}: {inside!r} is in {unit!r}; times must be in s, ms, us, min or h")
    return size


def _base(unit: str | None) -> tuple[str, float]:
    return ("1", 1.0) if unit is None else _KNOWN.get(_plain(unit), (unit, 1.0))


def _plain(unit: str) -> str:
    """Return the unit without a reference date (netCDF: "s since 2026-01-01"), and without ^ and **: m3 for m^3."""
    unit = unit.split(" since ")[0].strip()
    return unit if unit in _KNOWN else unit.replace("^", "").replace("**", "")


@dataclass(frozen=True, kw_only=True)
class Contents:
    """The contents of a file, or of a part of a log: arrays by the data set's names, with one "Cp" (n, sensors) in the
    layout's order. `files` were read. `unread` has the names in the file that were not used, `renamed` the names of
    series or sensors whose arrays have another name in the file, and `notes` further remarks for the user."""

    arrays: dict[str, Array]
    files: tuple[Path, ...]
    unread: tuple[str, ...] = ()
    renamed: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()


def read_columns(path: Path) -> Mapping[str, Stored | CsvColumn]:
    """Return the columns or arrays of a file by name. Raises DatasetError for an unreadable file."""
    return stored_arrays(path) if path.suffix.lower() in BINARY else read_csv(path)


def read_source(
    path: Path,
    layout: SensorLayout,
    names: Sequence[str],
    renamed: Mapping[str, str],
    references: Mapping[str, Reference],
) -> Contents:
    """Read the arrays in `names` that the file has, and the pressures. `renamed` has names in the file of series,
    sensors or Cp. `references` has values in the file that equal 1 in the data set, by series or sensor; the reference
    of Cp also applies to sensors. Raises DatasetError with file and array if the file cannot be read or lacks a renamed
    array, or if an array is no series of numbers or has an unknown unit."""
    if not path.is_file():
        raise DatasetError(f"{path}: is a folder without postProcessing" if path.is_dir() else f"{path}: no such file")
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise DatasetError(f"{path}: a data file must end in {', '.join(SUFFIXES)}, or belong to an OpenFOAM case")
    table = read_columns(path)
    wanted = (*names, *layout.names, *(["Cp"] if suffix in BINARY else []))
    renamed = _in_this_file(path, tuple(table), renamed, wanted)
    asked = {name: renamed.get(name, name) for name in wanted if renamed.get(name, name) in table}
    if "Cp" in asked:  # then arrays of single sensors are not used
        asked = {name: inside for name, inside in asked.items() if name not in layout.names}
    found, used = {}, set(asked.values())
    for name, inside in asked.items():
        found[name] = table[inside].numbers(path, inside, columns=name == "Cp", one=name == INITIAL_ACTION)
        if name == "Cp":
            if suffix == ".mat" and found[name].shape[0] == len(layout) != found[name].shape[1]:
                found[name] = found[name].T  # not every writer of MATLAB 7.3 files reverses the axes as MATLAB does
            found[name], names_of_columns = _ordered(path, found[name], layout, table)
            used |= names_of_columns
        unit = table[inside].unit or (split_unit(inside)[1] if inside != name else None)
        # Each column of a pressure array may have its own reference. A wrong number of columns is refused later.
        columns = layout.names if name == "Cp" and found[name].shape[1] == len(layout) else (name,)
        found[name] = found[name] * np.squeeze(
            [factor(path, name, inside, unit, reference_of(one, layout, references)) for one in columns]
        )
    return Contents(
        arrays=_with_pressures(path, found, layout, renamed, tuple(table)),
        unread=tuple(name for name in table if name not in used),
        renamed=frozenset(renamed),
        files=(path,),
    )


def reference_of(name: str, layout: SensorLayout, references: Mapping[str, Reference]) -> Reference | None:
    """Return the reference of a series or a sensor; None if there is none."""
    general = {INITIAL_ACTION: "action", **dict.fromkeys(layout.names, "Cp")}.get(name, name)
    return references.get(name) or references.get(general)


def _in_this_file(
    path: Path, there: Sequence[str], renamed: Mapping[str, str], wanted: Sequence[str]
) -> dict[str, str]:
    """Map the data set's names to this file's names if they differ, even if only by a unit in brackets. Raises
    DatasetError if a renamed array is in the file under neither name, because an optional series would be ignored."""
    plain = {split_unit(column)[0]: column for column in there}
    found = {name: plain[name] for name in wanted if name not in there and name in plain}
    for name, inside in renamed.items():
        if inside in there or inside in plain:
            found[name] = inside if inside in there else plain[inside]
        elif name not in there and name not in plain:
            option = f"--map {name}={inside}"
            raise DatasetError(f"{path}: no column {inside!r}, which {option} names; the file has {_listed(there)}")
    return found


def _ordered(
    path: Path, pressures: Array, layout: SensorLayout, table: Mapping[str, Stored | CsvColumn]
) -> tuple[Array, frozenset[str]]:
    """Return the pressures, and the name of an array in the file that lists the columns' sensors, if there is such an
    array. With this array the pressures are in the layout's order; otherwise their order is unchanged."""
    for name, one in table.items():
        texts = one.texts
        if len(texts) == pressures.shape[1] and set(texts) >= set(layout.names):
            if len(set(texts)) < len(texts):
                raise DatasetError(f"{path}: array {name!r} contains a sensor twice")
            return pressures[:, [texts.index(sensor) for sensor in layout.names]], frozenset({name})
    for name, one in table.items():
        lacking = [sensor for sensor in layout.names if sensor not in one.texts]
        if len(one.texts) == pressures.shape[1] and len(lacking) < len(layout):
            columns = f"array {name!r} contains the columns {_listed(one.texts)}"
            raise DatasetError(f"{path}: {columns}, but not the sensor {lacking[0]}")
    return pressures, frozenset()


def _with_pressures(
    path: Path, arrays: dict[str, Array], layout: SensorLayout, renamed: Mapping[str, str], there: Sequence[str]
) -> dict[str, Array]:
    found = {name: arrays.pop(name) for name in layout.names if name in arrays}
    if "Cp" in arrays:
        return arrays
    if len(found) < len(layout):
        missing = next(name for name in layout.names if name not in found)
        raise DatasetError(
            f"{path}: no column {renamed.get(missing, missing)!r} for the sensor {missing}; the file has "
            f"{_listed(there)}. Give the name with --map {missing}=NAME, or remove the sensor from the list of sensors"
        )
    lengths = {len(column) for column in found.values()}
    if len(lengths) > 1:
        raise DatasetError(f"{path}: the sensors' arrays have different lengths: {sorted(lengths)}")
    return {**arrays, "Cp": np.column_stack(list(found.values()))}


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 12 else f"{', '.join(names[:12])} and {len(names) - 12} more"
