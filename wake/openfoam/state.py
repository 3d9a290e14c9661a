"""A state from which an icoFoam run can continue: its field files, the measurements at that time, and the jets."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from contract.arrays import Array
from contract.atomic import replacing
from contract.errors import PlantError
from contract.npz import read_npz
from wake.openfoam import foam_files
from wake.openfoam.measurements import Readings, read_all

STATE_SCHEMA: Final = "stillwake-openfoam/1"

# The files of velocity, pressure and the flux through every face; U_0 and phi_0 are older values of U and phi.
_FIELDS: Final = ("U", "p", "phi", "U_0", "phi_0")
_POWERS: Final = dict.fromkeys(_FIELDS, 1) | {"p": 2}
"""The power of the velocity to which each field is proportional."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FoamState:
    """The data that determine how a case continues.

    Attributes:
        files: contents of the case's field files by name.
        dt: size of the last time step before the state, in t_c; the weights of the time scheme depend on it.
        action: jet flow rate in force, in U_inf W.
        substep: number of time steps since t = 0.
    """

    files: Mapping[str, bytes]
    dt: float
    readings: Readings
    action: float
    substep: int

    @property
    def velocity(self) -> Array:
        """The velocity in the mesh's m cells, (m, 2)."""
        return foam_files.parse_cells(self.files["U"], "U of a state")[:, :2]

    @property
    def pressure(self) -> Array:
        """The kinematic pressure in the cells, (m,)."""
        return foam_files.parse_cells(self.files["p"], "p of a state")


def scaled(state: FoamState, ratio: float) -> FoamState:
    """Return the state of a stream that is `ratio` times as fast. Velocities are multiplied by the ratio, pressures and
    forces by the square of the ratio."""
    readings = state.readings
    square = ratio * ratio
    return replace(
        state,
        files={name: foam_files.scaled(content, ratio ** _POWERS[name]) for name, content in state.files.items()},
        readings=Readings(
            forces=square * readings.forces, pressures=square * readings.pressures, wake=ratio * readings.wake
        ),
    )


def read_fields(folder: Path) -> dict[str, bytes]:
    """Read the field files of one time of a case. Raises PlantError if a file is missing."""
    try:
        return {name: (folder / name).read_bytes() for name in _FIELDS}
    except OSError as error:
        raise PlantError(f"{folder}: not a state of icoFoam ({error})") from error


def put(state: FoamState, case: Path) -> None:
    """Write a state as the start of a case, t = 0."""
    start = case / "0"
    (start / "uniform").mkdir(parents=True, exist_ok=True)
    for name, content in state.files.items():
        (start / name).write_bytes(content)
    (start / "uniform" / "time").write_text(foam_files.dictionary("time", {"deltaT0": state.dt}), encoding="ascii")


def written(folder: Path, dt: float) -> FoamState:
    """Read the last state of a case without jets, and set its clock to zero. Raises PlantError if there is no state
    after 0."""
    latest = foam_files.latest(folder)
    if latest is None:
        raise PlantError(f"{folder}: icoFoam has written no state")
    times, readings = read_all(folder)
    at = int(np.argmin(np.abs(times - float(latest.name))))
    return FoamState(files=read_fields(latest), dt=dt, readings=readings[at], action=0.0, substep=0)


def save(path: Path, state: FoamState, facts: str) -> None:
    """Write a state and a line that describes its settings, completely or not at all."""
    about = {"schema": STATE_SCHEMA, "facts": facts, "dt": state.dt, "action": state.action, "substep": state.substep}
    readings = state.readings
    arrays: dict[str, Any] = {name: np.frombuffer(content, np.uint8) for name, content in state.files.items()}
    arrays |= {"forces": readings.forces, "pressures": readings.pressures, "wake": readings.wake}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, about=json.dumps(about), **arrays)


def load(path: Path) -> tuple[FoamState, str]:
    """Read a state and the line that describes its settings. Raises PlantError if the file is missing, damaged or of
    another schema."""
    try:
        data = read_npz(path)
        about = json.loads(data.text("about"))
        if about["schema"] != STATE_SCHEMA:
            raise PlantError(f"{path}: schema {about['schema']!r}, this version reads {STATE_SCHEMA!r}")
        state = FoamState(
            files={name: data[name].tobytes() for name in _FIELDS},
            dt=float(about["dt"]),
            readings=Readings(forces=data["forces"], pressures=data["pressures"], wake=data["wake"]),
            action=float(about["action"]),
            substep=int(about["substep"]),
        )
        return state, str(about["facts"])
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise PlantError(f"{path}: not a state of the openfoam plant ({error})") from error
