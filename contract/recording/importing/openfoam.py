"""The import of an OpenFOAM case as an episode: pressures p of its probes, force coefficients, commanded actions."""

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from contract.arrays import Array, Index
from contract.errors import DatasetError
from contract.recording.importing.csv_table import read_csv
from contract.recording.importing.source_file import SUFFIXES, Contents, Reference, factor, reference_of
from contract.recording.importing.stored import INITIAL_ACTION
from contract.recording.openfoam_tables import FoamTable, read_foam_table
from contract.sensor_layout import SensorLayout

_ACTIONS: Final = "actions.csv"
"""Name of the file with the actions, beside the folder postProcessing. The columns of the file are t (time of the case)
and action. A case without this file counts as uncontrolled."""
_POST: Final = "postProcessing"
_PRESSURES: Final = r"p(_[-+.\de]+)?"
_FORCES: Final = r"(coefficient|forceCoeffs)(_[-+.\de]+)?\.dat"
_NUMBER: Final = re.compile(r"[-+]?\d*\.?\d+(?:[eE][-+]?\d+)?")
_NOT_FOUND: Final = 1e299
"""A probe whose value has a larger magnitude is outside the mesh; OpenFOAM then writes -1e300."""
_GAP: Final = 1.05
"""Largest time between two rows for which values between these rows are interpolated, in control periods."""
_AT: Final = 0.01
"""Largest distance of a probe from its sensor, as a share of the extent of the sensors."""


def case_of(path: Path) -> Path | None:
    """Return the OpenFOAM case of a path: its folder, or its postProcessing or anything there; None without a case."""
    path = Path(os.path.realpath(path))  # `resolve` raises RuntimeError for a cyclic link
    if (path / _POST).is_dir():
        return path
    if path.suffix.lower() in SUFFIXES:  # a user's table in this folder
        return None
    return next((one.parent for one in (path, *path.parents) if one.name == _POST and one.is_dir()), None)


def read_case(
    path: Path,
    case: Path,
    layout: SensorLayout,
    period: float,
    renamed: Mapping[str, str],
    references: Mapping[str, Reference],
) -> Contents:
    """Read a case into rows that are one control period apart. If the case's rows have other times, values are
    interpolated linearly. The kinematic pressure p is converted to Cp with `references` or with the magUInf of the
    force coefficients. The arguments are those of `contract.recording.importing.source_file.read_source`. Raises
    DatasetError if the tables cannot be read, or do not fit the layout or the period; the message states the file."""
    pressures, forces = _table(path, case, _PRESSURES, "probes of p"), _table(path, case, _FORCES, "forceCoeffs")
    speed = _speed(forces)
    if speed is None and "Cp" not in references:
        kinematic = "p is kinematic, so give U_inf^2 / 2 as in --reference Cp=200m2/s2"
        raise DatasetError(f"{forces.files[0]}: states no magUInf; {kinematic}")
    if speed != 1.0 and "t" not in references:
        stated = "" if speed is None else f", U_inf is {speed:g} m/s"
        raise DatasetError(f"{case}: its times are in s{stated}: give W / U_inf as in --reference t=0.005s")
    second = factor(path, "t", "Time", "s" if "t" in references else None, references.get("t"))
    cp = {name: reference_of(name, layout, references) for name in layout.names}
    scales = [factor(path, "Cp", "p", "m2/s2", one) if one else 2.0 / (speed or 0.0) ** 2 for one in cp.values()]
    readings = pressures.rows[:, 1 + _probes_of(pressures, layout)] * scales
    columns = forces.header[-1].split() if forces.header else []
    found = {name: renamed.get(name, name) for name in ("Cd", "Cl")}
    for name, inside in found.items():
        if columns.count(inside) != 1 or len(columns) != forces.rows.shape[1]:
            raise DatasetError(f"{forces.files[0]}: no column {inside!r} for {name}; the file has {', '.join(columns)}")
    scales = [factor(path, name, inside, None, references.get(name)) for name, inside in found.items()]
    coefficients = forces.rows[:, [columns.index(inside) for inside in found.values()]] * scales
    first, last = (max(pressures.rows[0, 0], forces.rows[0, 0]), min(pressures.rows[-1, 0], forces.rows[-1, 0]))
    # The tolerance is added because, with rounded times, the last period may appear too short.
    t = first * second + period * np.arange(max(0, int((last - first) * second / period + 1e-4) + 1))
    tables = ((pressures, readings), (forces, coefficients))
    at_periods = [_at(table.files[0], table.rows[:, 0] * second, values, t, period) for table, values in tables]
    scale = factor(path, "action", "action", None, references.get("action"))
    action, initial, files = _actions(case, t / second, scale)
    none = () if files else (f"no {_ACTIONS} beside {_POST}: the case counts as uncontrolled, with an action of 0",)
    return Contents(
        arrays={"t": t, "action": action, INITIAL_ACTION: initial, "Cp": at_periods[0]}
        | dict(zip(found, at_periods[1].T, strict=True)),
        unread=tuple(name for name in columns[1:] if name not in found.values()),
        notes=none,
        renamed=frozenset(found) & frozenset(renamed),
        files=(*pressures.files, *forces.files, *files),
    )


def _table(path: Path, case: Path, file: str, what: str) -> FoamTable:
    """Return the table of the function object whose folder contains the path, or else the case's only table."""
    tables = {}
    try:
        for folder in sorted((case / _POST).iterdir()):
            table = read_foam_table(folder, file)
            if table is not None:
                tables[folder] = table
    except (OSError, ValueError) as error:
        raise DatasetError(str(error)) from error
    named = [table for folder, table in tables.items() if Path(os.path.realpath(path)).is_relative_to(folder)]
    if len(named or tables) != 1:
        found = f"several contain {what}, name one: {', '.join(map(str, tables))}" if tables else f"holds no {what}"
        raise DatasetError(f"{case / _POST}: {found}")
    return (named or list(tables.values()))[0]


def _speed(forces: FoamTable) -> float | None:
    for line in forces.header:
        name, _, value = line.partition(":")
        if name.strip() == "magUInf" and _NUMBER.fullmatch(value.strip()):
            return float(value) or None
    return None


def _probes_of(pressures: FoamTable, layout: SensorLayout) -> Index:
    """Return the index of the probe at every sensor's position. If the case has another origin and length scale, but
    its probes are arranged like the sensors, the n-th probe belongs to the n-th sensor."""
    path, count = pressures.files[0], pressures.rows.shape[1] - 1
    numbers = [(line.split("(")[0].split()[:1], "(" in line, _NUMBER.findall(line)) for line in pressures.header]
    places = [found[1:3] for word, bracket, found in numbers if word == ["Probe"] and bracket and len(found) == 4]
    if not places:  # older versions write a line for every coordinate
        lines = [found for word, _, found in numbers if word in (["x"], ["y"])]
        places = np.array(lines).T.tolist() if len({len(line) for line in lines}) == 1 else []
    if len(places) != count:
        raise DatasetError(f"{path}: its header has positions of {len(places)} probes; its rows have {count} pressures")
    at, wanted = np.array(places, dtype=np.float64), layout.positions
    near = _AT * max(float(np.ptp(wanted, axis=0).max()), 1e-6)
    close = np.hypot(*(at[None] - wanted[:, None]).transpose(2, 0, 1)) <= near
    if (close.sum(axis=1) == 1).all():
        chosen: Index = np.argmax(close, axis=1)
    else:
        chosen = np.arange(len(layout))
        if len(at) != len(layout) or not _alike(at, wanted, near):
            name = layout.names[int(np.argmax(close.sum(axis=1) != 1))]
            raise DatasetError(
                f"{path}: no probe, or more than one of the {count} probes, is at the sensor {name}: correct the "
                f"sensor's position, or list one sensor for each probe, in the order of the probes"
            )
    lost = np.abs(pressures.rows[:, 1 + chosen]).max(axis=0) > _NOT_FOUND
    if lost.any():
        raise DatasetError(f"{path}: probe {chosen[int(lost.argmax())]} is not in the mesh: it reads -1e300")
    return chosen


def _alike(at: Array, wanted: Array, near: float) -> bool:
    """Return whether two sets of positions are equal except for origin and length scale."""
    moved, meant = at - at.mean(axis=0), wanted - wanted.mean(axis=0)
    length = float((moved * meant).sum() / max(float((moved**2).sum()), 1e-300))
    return len(at) > 1 and length > 0 and bool((np.hypot(*(length * moved - meant).T) <= near).all())


def _at(path: Path, times: Array, values: Array, t: Array, period: float) -> Array:
    if len(t) < 2:
        raise DatasetError(
            f"{path}: its times go from {times[0]:g} to {times[-1]:g} W / U_inf, but two control periods are needed in "
            f"which both probes and coefficients have rows; for times in s, give W / U_inf in s as --reference t=NUMBER"
        )
    if (np.diff(times) <= 0).any():
        k = int(np.argmax(np.diff(times) <= 0))
        raise DatasetError(
            f"{path}: its times do not rise from row {k} to {k + 1}: {times[k]:.15g}, {times[k + 1]:.15g}"
        )
    rows = slice(max(int(np.searchsorted(times, t[0], side="right")) - 1, 0), int(np.searchsorted(times, t[-1])) + 1)
    gap = float(np.diff(times[rows]).max())
    if gap > _GAP * period:
        raise DatasetError(
            f"{path}: rows are up to {gap:.6g} W / U_inf apart: write one row per control period, {period:g} W / U_inf"
        )
    return np.column_stack([np.interp(t, times, column) for column in values.T])


def _actions(case: Path, t: Array, scale: float) -> tuple[Array, Array, tuple[Path, ...]]:
    """Return the actions commanded at the times t, the action before the first time, and the actions' file, if any."""
    path = case / _ACTIONS
    if not path.is_file():
        return np.zeros(len(t)), np.zeros(1), ()
    table = read_csv(path)
    for name in ("t", "action"):
        if name not in table:
            raise DatasetError(f"{path}: no column {name!r}: the file must have t (the case's own time) and action")
    times, commands = table["t"].numbers(path, "t"), table["action"].numbers(path, "action") * scale
    if (np.diff(times) <= 0).any():
        raise DatasetError(f"{path}: t does not rise at row {int(np.argmax(np.diff(times) <= 0)) + 1}")
    # A command is in force until the next command; the tolerance allows for rounded times.
    within = 1e-6 * max(1.0, float(np.abs(t).max()))
    at = np.searchsorted(times, t + within, side="right") - 1
    before = int(np.searchsorted(times, t[0] - within)) - 1
    commands = np.append(commands, 0.0)  # before the first command, the index is -1 and selects this action
    return commands[at], commands[[before]], (path,)
