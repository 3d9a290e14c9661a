"""A state from which an icoFoam run can continue: field files, measurements at that time, and the jets' action.

icoFoam computes the wake without jets only once. The result is stored, and closed-loop runs start from this state.
"""

import json
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from contract.arrays import Array
from contract.atomic import replacing
from contract.config.body import TRUCK_BODY, BodyConfig
from contract.config.plant import FlowConfig, OpenFoamConfig
from contract.errors import PlantError
from contract.npz import read_npz
from wake.openfoam import case, foam_files
from wake.openfoam.measurements import Readings, read_at
from wake.openfoam.mesh import Mesh, truck_mesh
from wake.openfoam.process import LOG, IcoFoam, require_installed
from wake.solver.grid import Flow, truck_grid
from wake.truck.develop import FlowProgress, at_points
from wake.truck.state import State, developed_state

STATE_SCHEMA: Final = "stillwake-openfoam/1"
_POWERS: Final = dict.fromkeys(foam_files.FIELDS, 1) | {"p": 2}
"""The exponent n for each field; the field is proportional to the velocity's n-th power."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FoamState:
    """The data that determine how a case continues: the contents of its field files by name, the size of the last time
    step in t_c (the weights of the time scheme depend on it), the measurements, the jet flow rate in force in U_inf W,
    and the number of time steps since t = 0."""

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
    """Return the state of a stream `ratio` times as fast, with pressures and forces times the ratio's square."""
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
        return {name: (folder / name).read_bytes() for name in foam_files.FIELDS}
    except OSError as error:
        raise PlantError(f"{folder} is not a state of icoFoam ({error})") from error


def put(state: FoamState, folder: Path) -> None:
    """Write a state into a case as the case's state at t = 0."""
    start = folder / "0"
    (start / "uniform").mkdir(parents=True, exist_ok=True)
    for name, content in state.files.items():
        (start / name).write_bytes(content)
    (start / "uniform" / "time").write_text(foam_files.dictionary("time", {"deltaT0": state.dt}), encoding="ascii")


def written(folder: Path, dt: float) -> FoamState:
    """Read the last state of a case without jets, at time zero. Raises PlantError if there is none after t = 0."""
    latest = foam_files.latest(folder)
    if latest is None:
        raise PlantError(f"{folder}: icoFoam has written no state")
    readings = read_at(folder, float(latest.name))
    return FoamState(files=read_fields(latest), dt=dt, readings=readings, action=0.0, substep=0)


def save(path: Path, state: FoamState, facts: str) -> None:
    """Write a state and a line that describes its settings, completely or not at all."""
    about = {"schema": STATE_SCHEMA, "facts": facts, "dt": state.dt, "action": state.action, "substep": state.substep}
    readings = state.readings
    arrays: dict[str, Any] = {name: np.frombuffer(content, np.uint8) for name, content in state.files.items()}
    arrays |= {"forces": readings.forces, "pressures": readings.pressures, "wake": readings.wake}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, about=json.dumps(about), **arrays)


def load(path: Path) -> tuple[FoamState, str]:
    """Read a state and the line that describes its settings. Raises PlantError if the file is no such state."""
    try:
        data = read_npz(path)
        about = json.loads(data.text("about"))
        if about["schema"] != STATE_SCHEMA:
            raise PlantError(f"{path} has schema {about['schema']!r}, but this version reads {STATE_SCHEMA!r}")
        state = FoamState(
            files={name: data[name].tobytes() for name in foam_files.FIELDS},
            dt=float(about["dt"]),
            readings=Readings(forces=data["forces"], pressures=data["pressures"], wake=data["wake"]),
            action=float(about["action"]),
            substep=int(about["substep"]),
        )
        return state, str(about["facts"])
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise PlantError(f"{path} is not a state of the openfoam plant ({error})") from error


def from_own_solver(state: State, mesh: Mesh) -> tuple[Array, Array]:
    """Interpolate a state linearly from the grid of refinement 1 to the mesh's m cells. Returns velocity (m, 2) and
    kinematic pressure (m,). Values between the grid's outermost points and the boundary are extrapolated. The first
    time step removes the divergence that the interpolation leaves."""
    grid = truck_grid()
    flow, at = Flow.of(state.flat, grid.shape), mesh.centres
    return np.column_stack([at_points(flow, grid, name, at) for name in ("u", "v")]), at_points(flow, grid, "p", at)


_CHECKPOINT: Final = 5.0  # longest time between two written states, in t_c
_LOOK_S: Final = 0.5


def require_truck(body: BodyConfig) -> None:
    """Raise PlantError for a body other than the truck, because this plant has a mesh of the truck only."""
    for name in ("length", "leading_edge_radius", "sensors_per_side", "sensors_on_base"):
        value, truck = getattr(body, name), getattr(TRUCK_BODY, name)
        if value != truck:
            raise PlantError(f"body.{name} = {value}: must be {truck}, because OpenFOAM's mesh is for the truck")


def _settle(folder: Path, mesh: Mesh, config: FlowConfig, foam: OpenFoamConfig, progress: FlowProgress) -> None:
    """Run the case in `folder` without jets until `foam.develop_time`, a whole number of control periods. If the case
    has complete checkpoints, continue from the last of them."""
    until, substeps = foam.develop_time, foam.develop_substeps
    if not (folder / "0" / "p").is_file():
        shutil.rmtree(folder, ignore_errors=True)
        case.write_mesh(folder, mesh)
        case.write_rest(folder, mesh)
        case.write_start(folder, *from_own_solver(developed_state(), mesh))
    foam_files.remove_incomplete(folder)
    latest = foam_files.latest(folder)
    if latest is not None and float(latest.name) > until - 0.5 * config.control_period:
        progress(until, until)
        return
    periods = round(until / config.control_period)
    # The checkpoint interval divides the run exactly, so that the last checkpoint is at the run's end.
    every = max(n for n in range(1, round(_CHECKPOINT / config.control_period) + 1) if periods % n == 0)
    dt = config.control_period / substeps
    counts = {"steps_per_write": every * substeps, "steps_per_sample": substeps}
    case.write_settings(folder, mesh, config, end=until, dt=dt, **counts)
    (folder / LOG).unlink(missing_ok=True)
    probe = folder / "postProcessing" / case.PROBE_OBJECT / ("0" if latest is None else latest.name) / "U"
    with IcoFoam(folder) as child:
        while not child.wait(_LOOK_S):
            progress(_last_time(probe), until)
    progress(until, until)


def developed(
    folder: Path, config: FlowConfig, foam: OpenFoamConfig, progress: FlowProgress = lambda t, total: None
) -> FoamState:
    """Return the developed wake. If `folder/developed.npz` has a wake for these settings, this wake is read. Otherwise
    the wake is computed, in minutes, from the developed wake of stillwake's solver, and stored in this file. If a call
    is interrupted, the next one continues. Raises PlantError if icoFoam is missing or fails, or the file is damaged."""
    require_installed()
    mesh, path = truck_mesh(foam.refinement), folder / "developed.npz"
    facts = f"{len(mesh.cells)} cells, Re {config.reynolds:g}, {foam.develop_time:g} t_c at 1/{foam.develop_substeps}"
    # States of earlier versions cannot be used, because their inlet velocity cannot change. Their line lacks this text.
    facts += ", inlet from files"
    if path.is_file():
        kept, made_with = load(path)
        if made_with == facts:
            return kept
    # The case's name contains its settings, because a case must not be continued with other settings.
    work = folder / re.sub(r"[^\w.]+", "-", f"developing {facts}")
    _settle(work, mesh, config, foam, progress)
    state = written(work, dt=config.control_period / foam.develop_substeps)
    save(path, state, facts)
    shutil.rmtree(work)
    return state


def _last_time(probe: Path) -> float:
    try:
        return float(probe.read_bytes().splitlines()[-1].split()[0])
    except (OSError, IndexError, ValueError):
        return 0.0
