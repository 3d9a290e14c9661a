"""The second plant: OpenFOAM's icoFoam solves the flow on a body-fitted mesh. The truck, the jets and the clock are the
same as in stillwake's own solver. The interface is that of `wake.truck.truck_wake.TruckWake`, with two limits. A run's
duration is limited, because icoFoam needs all times in advance. States exist only at a control period's end."""

import shutil
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.spatial import Delaunay

from contract import sensors
from contract.arrays import Array
from contract.config.body import TRUCK_BODY
from contract.config.plant import FlowConfig
from contract.errors import PlantError
from contract.runtime.copies import NeverCopied
from wake.openfoam import case, foam_files
from wake.openfoam.measurements import Follower, Instruments
from wake.openfoam.mesh import truck_mesh
from wake.openfoam.process import IcoFoam, require_installed
from wake.openfoam.state import FoamState, put, read_fields, scaled
from wake.plant.drive import Wind
from wake.plant.protocol import SteppedPlant
from wake.plant.sample import Sample
from wake.solver.grid import Grid, truck_grid


class OpenFoamWake(NeverCopied, SteppedPlant):
    """The flow around the truck, in a new case in `folder`; an existing case there is removed. Use this class in a
    `with` statement or call `close`: icoFoam is a child process. `refinement` divides every spacing of the mesh; it
    must equal the state's refinement. `duration` is the longest time that can be run after a `reset`, in t_c. `wind` is
    as in `TruckWake`. Raises PlantError if icoFoam is not installed, does not accept the state, or fails."""

    INSTEAD: ClassVar = "icoFoam is a process; give the plant's state() to another OpenFoamWake"

    def __init__(
        self, folder: Path, state: FoamState, config: FlowConfig, refinement: float, *, duration: float = 200.0
    ) -> None:
        require_installed()
        self.config = config
        self.body, self.layout = TRUCK_BODY, sensors.TRUCK
        self.mesh = truck_mesh(refinement)
        self.grid: Grid = truck_grid()
        """Grid of `vorticity`: the grid of stillwake's solver, so that pictures of the two plants can be compared."""
        self._case = folder
        self._steps = round(duration / self.config.control_period) * self.config.substeps
        self._instruments = Instruments(self.mesh)
        self._child: IcoFoam | None = None
        self.wind: Wind | None = None
        self.reset(state)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        self.close()
        if kind is None:
            # The case of a failed run is not removed, so that it can be inspected.
            shutil.rmtree(self._case, ignore_errors=True)

    @property
    def description(self) -> str:
        return f"OpenFOAM icoFoam, {len(self.mesh.cells)} cells, dt 1/{1.0 / self.dt:g}"

    def reset(self, state: FoamState) -> Sample:
        """Restart icoFoam from a state. The restart is not exact: one control period later, the forces differ by a
        fraction of a percent from the forces of an uninterrupted run. Raises PlantError if the state has another mesh
        or clock or is not finite, or icoFoam does not start."""
        velocity = state.velocity
        if len(velocity) != len(self.mesh.cells):
            raise PlantError(f"flow state has {len(velocity)} cells, but this mesh has {len(self.mesh.cells)}")
        if not (np.isfinite(velocity).all() and np.isfinite(state.pressure).all()):
            raise PlantError("flow state holds values that are not finite")
        # As in stillwake's solver, a state at t = 0 can continue with any clock.
        if state.substep and (abs(state.dt - self.dt) > 1e-9 or state.substep % self.config.substeps):
            raise PlantError(
                f"flow state is at step {state.substep} of a clock with dt = {state.dt:g}, this plant has "
                f"{self.config.substeps} substeps of {self.dt:g} in a control period"
            )
        self.close()
        shutil.rmtree(self._case, ignore_errors=True)
        case.write_mesh(self._case, self.mesh)
        put(state, self._case)
        every = self.config.substeps
        # The case has one step more than the longest run, so that icoFoam waits after the run's last step.
        times = {"end": (self._steps + 1) * self.dt, "dt": self.dt}
        case.write_settings(self._case, self.mesh, self.config, **times, steps_per_write=every, steps_per_sample=1)
        stream = self._stream(state.substep)
        case.write_pipes(self._case, self.mesh, dt=self.dt, steps=self._steps + 1, action=state.action, stream=stream)
        self._follower = Follower(self._case)
        self._child = IcoFoam(self._case, self.mesh)
        self._first = self._substep = state.substep
        self._state, self._action = state, state.action
        self._readings = state.readings
        self._child.wait_for_step()
        return self.sample()

    def state(self) -> FoamState:
        """Return a state for a later `reset`. Raises PlantError if called in the middle of a control period."""
        if self._substep == self._first:
            return self._state
        files, now = read_fields(self._latest()), self._readings
        return FoamState(files=files, dt=self.dt, readings=now, action=self._action, substep=self._substep)

    def advance_to(self, substep: int, action: float | None = None) -> None:
        """Advance as `wake.truck.truck_wake.TruckWake.advance_to` does. Raises that method's errors, and PlantError if
        icoFoam fails or the run would be longer than `duration`."""
        steps, reached, in_force = self._ramp(substep, action)
        if self._child is None:
            raise PlantError("the openfoam plant is closed")
        if self._substep - self._first + steps > self._steps:
            raise PlantError(f"cannot run past {self._steps * self.dt:g} t_c: give a longer duration")
        for step in range(1, steps + 1):
            ramped = self._action + (reached - self._action) * step / steps
            self._child.send(ramped, self._stream(self._substep + step))
        self._child.wait_for_step()
        self._readings = self._follower.read()
        self._substep += steps
        self._action = in_force
        # `sample` makes the same check, but a run may end without a call of `sample`.
        self._readings.require_finite(self.t)

    def sample(self) -> Sample:
        now, before, earlier = (self._stream(self._substep - ago) for ago in range(3))
        # The derivative uses icoFoam's time scheme, so that it is consistent with icoFoam's pressures.
        acceleration = (3.0 * now - 4.0 * before + earlier) / (2.0 * self.dt)
        return self._instruments.sample(self._readings, t=self.t, action=self._action, acceleration=acceleration)

    def set_reynolds(self, reynolds: float) -> None:
        """Restart icoFoam with the viscosity of another Reynolds number. Raises PlantError if called in the middle of a
        control period, or if icoFoam does not start."""
        state = self.state()
        self.config = replace(self.config, reynolds=reynolds)
        self.reset(state)

    def scale(self, ratio: float) -> None:
        """Restart icoFoam with a flow that is scaled as in `TruckWake.scale`. Raises the errors of `set_reynolds`."""
        self.reset(scaled(self.state(), ratio))

    def vorticity(self) -> Array:
        """Return dv/dx - du/dy at the corners of `grid`. Raises PlantError in the middle of a control period."""
        grid = self.grid
        velocity, points = self.state().velocity, np.stack(np.meshgrid(grid.xc, grid.yc, indexing="ij"), axis=-1)
        at_points = LinearNDInterpolator(self._triangles, velocity)(points)
        # Outside the triangles between the cells' centres, the value of the nearest cell is used.
        outside = np.isnan(at_points[..., 0])
        at_points[outside] = NearestNDInterpolator(self.mesh.centres, velocity)(points[outside])
        u, v = np.moveaxis(at_points, 2, 0)
        inside = np.zeros(grid.shape, dtype=bool)
        inside[grid.front : grid.rear, grid.lower : grid.upper] = True
        u[inside] = v[inside] = 0.0
        dvdx = np.diff(0.5 * (v[:, 1:] + v[:, :-1]), axis=0) / grid.dxc[1:-1, None]
        dudy = np.diff(0.5 * (u[1:] + u[:-1]), axis=1) / grid.dyc[None, 1:-1]
        return np.asarray(dvdx - dudy)

    @cached_property
    def _triangles(self) -> Delaunay:
        return Delaunay(self.mesh.centres)

    def pressure(self) -> None:
        """Return None: the pressure is available at the sensors only."""

    def _stream(self, substep: int) -> float:
        return 1.0 if self.wind is None else 1.0 + self.wind(substep * self.dt)

    def close(self) -> None:
        if self._child is not None:
            self._child.stop()
        self._child = None

    def _latest(self) -> Path:
        latest, at = foam_files.latest(self._case), (self._substep - self._first) * self.dt
        if latest is None or abs(float(latest.name) - at) > 0.5 * self.dt:
            raise PlantError("fields of the openfoam plant exist only at the end of a control period")
        return latest
