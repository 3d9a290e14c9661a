"""The conversion of files from icoFoam's function objects into samples of the plant.

The domain has depth 1, so forces in units of rho U_inf^2 W / 2 are twice the kinematic forces.

If the stream's speed U changes, icoFoam accelerates the air between inlet and outlet by a pressure gradient -dU/dt. On
a road, the air is at rest and the vehicle accelerates, so this gradient does not exist. The samples are for a vehicle,
as in stillwake's solver: the pressures and forces that the gradient causes are subtracted.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from contract import sensors
from contract.arrays import Array
from contract.errors import PlantError
from contract.geometry import DOMAIN_X
from contract.recording.openfoam_tables import read_foam_table
from wake.openfoam.case import FORCE_OBJECTS, PRESSURES, PROBE_OBJECT, pressure_points, sensor_weights
from wake.openfoam.mesh import Mesh
from wake.plant.sample import Sample
from wake.truck.surface import MOMENTUM_FACTOR

_FILES: Final = {**dict.fromkeys(FORCE_OBJECTS.values(), "force.dat"), PRESSURES: "p", PROBE_OBJECT: "U"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """The measurements at one time, read from one line of each function object's file: kinematic force vectors (3, 3,
    3), kinematic pressures at the probed cells, and the velocity at the wake probe (3,). The first axis of the forces
    is truck, upper slot, lower slot; the second is total, pressure and viscous force."""

    forces: Array
    pressures: Array
    wake: Array

    def require_finite(self, t: float) -> None:
        """Raise PlantError if a number is not finite, as in a diverged flow; t is the time of the measurement."""
        if not all(np.isfinite(values).all() for values in (self.forces, self.pressures, self.wake)):
            raise PlantError(f"the flow diverged at t = {t:.2f}: take more time steps per control period")


class Instruments:
    """A converter from readings on one mesh to samples."""

    def __init__(self, mesh: Mesh) -> None:
        self._weights = sensor_weights(mesh)
        self._upstream = pressure_points(mesh)[:, 0] - DOMAIN_X[1]
        self._buoyancy = np.array([_buoyancy(mesh, patch) for patch in FORCE_OBJECTS])

    def sample(self, readings: Readings, *, t: float, action: float, acceleration: float = 0.0) -> Sample:
        """Return the sample at time t. `action` is the jet flow rate in force; `acceleration` is the stream's
        acceleration in U_inf / t_c. Raises PlantError if a reading is not finite, or their number is not the mesh's."""
        if readings.pressures.shape != (self._weights.shape[1],):
            raise PlantError(f"{readings.pressures.size} pressures were read for {self._weights.shape[1]} probes")
        readings.require_finite(t)
        cp = self._weights @ (readings.pressures + acceleration * self._upstream)
        forces = readings.forces.copy()
        forces[:, :2, 0] -= acceleration * self._buoyancy[:, None]
        truck, slots = 2.0 * forces[0, 0], 2.0 * forces[1:].sum(axis=0)
        upper, lower = cp[sensors.COUNT :]
        return Sample(
            t=t,
            Cp=cp[: sensors.COUNT],
            Cd=float(truck[0]),
            Cl=float(truck[1]),
            Cd_slot_pressure=float(slots[1, 0]),
            Cd_slot_viscous=float(slots[2, 0]),
            Cd_momentum=-4.0 * MOMENTUM_FACTOR * action**2,
            jet_power=float(action * (upper - lower)),
            Uy_probe=float(readings.wake[1]),
            action=action,
        )


def _buoyancy(mesh: Mesh, patch: str) -> float:
    """Return the force in x that a pressure with gradient -1 and the value 0 at the outlet exerts on a patch."""
    ends = mesh.points[mesh.patches[patch]]
    # The flow is on the left of an edge, so `facing` is the wall's area in x, positive if the wall faces downstream.
    facing = ends[:, 0, 1] - ends[:, 1, 1]
    return float((mesh.patch_centres(patch)[:, 0] - DOMAIN_X[1]) @ facing)


class Follower:
    """A reader of the newest measurements of a case in which icoFoam runs."""

    def __init__(self, folder: Path) -> None:
        self._paths = {name: folder / "postProcessing" / name / "0" / file for name, file in _FILES.items()}
        self._offsets = dict.fromkeys(_FILES, 0)

    def read(self) -> Readings:
        """Read the last line of every file. Raises PlantError if a file has no new line since the last call."""
        return _readings({name: self._last(name) for name in _FILES})

    def _last(self, name: str) -> Array:
        path = self._paths[name]
        try:
            with path.open("rb") as file:
                file.seek(self._offsets[name])
                content = file.read()
        except OSError as error:
            raise PlantError(f"{path}: icoFoam has written no measurements ({error.strerror})") from error
        whole = content[: content.rfind(b"\n") + 1]
        self._offsets[name] += len(whole)
        lines = [line for line in whole.splitlines() if not line.startswith(b"#")]
        if not lines:
            raise PlantError(f"{path}: icoFoam has written no new measurement")
        return np.array(lines[-1].translate(None, b"()").split(), dtype=np.float64)


def read_at(folder: Path, t: float) -> Readings:
    """Read the measurements of a whole case, which may have been restarted, at the time nearest to t. Raises PlantError
    if the case holds no measurements."""
    rows = {}
    for name, file in _FILES.items():
        path = folder / "postProcessing" / name
        try:
            table = read_foam_table(path, re.escape(file), cut_off=True)
        except (OSError, ValueError) as error:
            raise PlantError(f"{path}: {error}") from error
        if table is None:
            raise PlantError(f"{path}: icoFoam has written no measurements")
        rows[name] = table.rows[np.abs(table.rows[:, 0] - t).argmin()]
    return _readings(rows)


def _readings(rows: dict[str, Array]) -> Readings:
    forces = [rows[name][1:].reshape(3, 3) for name in FORCE_OBJECTS.values()]
    return Readings(forces=np.array(forces), pressures=rows[PRESSURES][1:], wake=rows[PROBE_OBJECT][1:])
