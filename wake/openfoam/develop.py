"""The wake without jets. icoFoam computes this wake once; it is stored, and closed-loop runs start from it."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from contract.arrays import Array
from contract.config.body import TRUCK_BODY, BodyConfig
from contract.config.plant import FlowConfig, OpenFoamConfig
from contract.errors import PlantError
from wake.openfoam import case, foam_files, wall
from wake.openfoam.mesh import Mesh, truck_mesh
from wake.openfoam.process import LOG, IcoFoam, require_installed
from wake.openfoam.state import FoamState, load, save, written
from wake.solver.flow import Flow
from wake.solver.grid import truck_grid
from wake.truck.state import State, developed_state


def from_own_solver(state: State, mesh: Mesh) -> tuple[Array, Array]:
    """Interpolate a state on the grid of refinement 1 linearly to velocity (m, 2) and kinematic pressure (m,) in the
    mesh's m cells. Values between the grid's outermost points and the boundary are extrapolated. The first time step
    removes the divergence that the interpolation leaves."""
    grid = truck_grid()
    flow = Flow.of(state.flat, grid.shape)
    at = mesh.centres

    def read(x: Array, y: Array, values: Array) -> Array:
        look_up = RegularGridInterpolator((x, y), values, bounds_error=False, fill_value=None)
        return np.asarray(look_up(at))

    u = read(*grid.axes("u"), flow.faces_u)
    v = read(*grid.axes("v"), flow.faces_v)
    p = read(*grid.axes("p"), flow.cells_p)
    return np.column_stack([u, v]), p


_Progress = Callable[[float, float], None]

_CHECKPOINT: Final = 5.0  # longest time between two written states, in t_c
_LOOK_S: Final = 0.5


def require_truck(body: BodyConfig) -> None:
    """Raise PlantError for a body other than the truck, because this plant has a mesh of the truck only."""
    for name in ("length", "leading_edge_radius", "sensors_per_side", "sensors_on_base"):
        value, truck = getattr(body, name), getattr(TRUCK_BODY, name)
        if value != truck:
            raise PlantError(f"body.{name} = {value}: OpenFOAM's mesh is for the truck, with {truck}; leave body.* out")


def _settle(folder: Path, mesh: Mesh, config: FlowConfig, foam: OpenFoamConfig, progress: _Progress) -> None:
    """Run the case in `folder` without jets until `foam.develop_time`, a whole number of control periods. If the case
    has a checkpoint, continue from the last checkpoint."""
    until, substeps = foam.develop_time, foam.develop_substeps
    if not (folder / "0" / "p").is_file():
        shutil.rmtree(folder, ignore_errors=True)
        case.write_mesh(folder, mesh)
        wall.write_rest(folder, mesh)
        case.write_start(folder, *from_own_solver(developed_state(), mesh))
    latest = foam_files.latest(folder)
    if latest is not None and float(latest.name) > until - 0.5 * config.control_period:
        progress(until, until)
        return
    periods = round(until / config.control_period)
    # The checkpoint interval divides the run exactly, so that the last checkpoint is at the run's end.
    every = max(n for n in range(1, round(_CHECKPOINT / config.control_period) + 1) if periods % n == 0)
    dt = config.control_period / substeps
    clock = case.CaseClock(end=until, dt=dt, steps_per_write=every * substeps, steps_per_sample=substeps)
    case.write_settings(folder, mesh, config, clock)
    (folder / LOG).unlink(missing_ok=True)
    probe = folder / "postProcessing" / case.PROBE_OBJECT / ("0" if latest is None else latest.name) / "U"
    with IcoFoam(folder) as child:
        while not child.wait(_LOOK_S):
            progress(_last_time(probe), until)
    progress(until, until)


def developed(
    folder: Path, config: FlowConfig, foam: OpenFoamConfig, progress: _Progress = lambda t, total: None
) -> FoamState:
    """Return the developed wake. It is read from `folder/developed.npz` if it was computed with these settings.
    Otherwise it is computed, in minutes, from the developed wake of stillwake's solver, and stored in this file. A
    later call continues an interrupted computation. Raises PlantError if icoFoam is missing or fails, or the stored
    file is damaged."""
    require_installed()
    mesh, path = truck_mesh(foam.refinement), folder / "developed.npz"
    facts = f"{len(mesh.cells)} cells, Re {config.reynolds:g}, {foam.develop_time:g} t_c at 1/{foam.develop_substeps}"
    # States of earlier versions lack this text, because the velocity at their inlet cannot change.
    facts += ", inlet from files"
    if path.is_file():
        kept, made_with = load(path)
        if made_with == facts:
            return kept
    # The case is named after its settings, because it must not be continued with other settings.
    work = folder / re.sub(r"[^\w.]+", "-", f"developing {facts}")
    _settle(work, mesh, config, foam, progress)
    state = written(work, dt=config.control_period / foam.develop_substeps)
    save(path, state, facts)
    shutil.rmtree(work)
    return state


def _last_time(probe: Path) -> float:
    """Return the time of the last line of a probe's file; 0 if there is no line."""
    try:
        with probe.open("rb") as file:
            file.seek(-min(400, probe.stat().st_size), 2)
            lines = file.read().splitlines()
        return float(lines[-1].split()[0])
    except (OSError, IndexError, ValueError):
        return 0.0
