"""An icoFoam case of the truck: schemes, solvers, boundaries, sensors, and function objects for measurements.

`timeVaryingMappedFixedValue` reads a patch's velocity at each listed instant from a file, and ramps linearly between
instants. The velocity is uniform at the inlet and a parabola over each slot. The list of a case without control has the
start and a time that is never reached. In a closed loop it has the end of every time step, and the files are pipes.

The pressure on a wall face equals the pressure in its cell (zero normal gradient at the wall), so a sensor's pressure
is interpolated linearly along the wall between the two nearest faces.
"""

import os
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from contract import sensors
from contract.arrays import Array
from contract.config.plant import FlowConfig
from contract.geometry import HALF_WIDTH, JET_WIDTH, LEADING_EDGE_RADIUS, LENGTH, WAKE_PROBE
from wake.openfoam import foam_files
from wake.openfoam.mesh import PATCHES, Mesh

JETS: Final = ("jetUpper", "jetLower")
DRIVEN: Final = ("inlet", *JETS)
"""The patches whose velocity changes with time, in the order in which icoFoam updates them."""
FORCE_OBJECTS: Final = {"truck": "forcesTruck", "jetUpper": "forcesJetUpper", "jetLower": "forcesJetLower"}
"""The name of the function object that measures the force on a patch, by the patch's name."""
BOUNDARY: Final[dict[str, Any]] = {
    "type": "timeVaryingMappedFixedValue",
    "offset": (0, 0, 0),
    "setAverage": False,
    "perturb": 0,
    "mapMethod": "nearest",
    "value": "uniform (0 0 0)",
}

_NEVER: Final = "1000000"
# Each instant is later than its step's end by this fraction of a time step, so that rounding cannot place it before.
_LATE: Final = 1e-6


def patch_velocity(mesh: Mesh, patch: str, action: float, stream: float) -> Array:
    """Return the velocity on the k faces of a patch in `DRIVEN`, in the mesh's order, (k, 2). On a slot, the velocity
    is averaged exactly over each face. `action` is the jet flow rate; the lower slot blows when the upper slot sucks
    (paper, section 2.1). `stream` is the free stream in U_inf."""
    y = mesh.patch_centres(patch)[:, 1]
    if patch not in JETS:
        return np.column_stack([np.full(len(y), stream), np.zeros(len(y))])
    shares = slot_shares(len(y))[np.argsort(np.argsort(y))]
    sign = 1.0 if patch == "jetUpper" else -1.0
    speed = sign * action * shares * len(y) / JET_WIDTH
    return np.column_stack([speed, np.zeros(len(y))])


def velocities(mesh: Mesh, patch: str, action: float, stream: float = 1.0) -> str:
    """Return the text of the file for one instant, with the values of `patch_velocity`."""
    return foam_files.vectors(patch_velocity(mesh, patch, action, stream)) + "\n"


def pipe(folder: Path, patch: str) -> Path:
    """Return the path of a patch's named pipe in a closed-loop case."""
    return folder / "pipes" / patch / "U"


def write_rest(folder: Path, mesh: Mesh) -> None:
    """Write the velocity files of a case with a steady stream and without jets."""
    for patch in DRIVEN:
        data = _begin(folder, mesh, patch, 0.0, 1.0)
        (data / _NEVER).mkdir(exist_ok=True)
        (data / _NEVER / "U").write_text(velocities(mesh, patch, 0.0), encoding="ascii")


def write_pipes(folder: Path, mesh: Mesh, *, dt: float, steps: int, action: float, stream: float = 1.0) -> None:
    """Write the velocity files of a case in closed loop. Jets and inlet start from `action` and `stream`. The velocity
    is listed at the end of every time step. For each such instant, a link leads to the folder with the patch's pipe."""
    for patch in DRIVEN:
        data, end = _begin(folder, mesh, patch, action, stream), pipe(folder, patch)
        end.parent.mkdir(parents=True)
        os.mkfifo(end)
        target = Path(os.path.relpath(end.parent, data))
        for step in range(1, steps + 1):
            (data / f"{(step + _LATE) * dt:.12g}").symlink_to(target)


def _begin(folder: Path, mesh: Mesh, patch: str, action: float, stream: float) -> Path:
    data = folder / "constant" / "boundaryData" / patch
    (data / "0").mkdir(parents=True, exist_ok=True)
    (data / "0" / "U").write_text(velocities(mesh, patch, action, stream), encoding="ascii")
    centres = [f"({x:.17g} {y:.17g} 0.5)" for x, y in mesh.patch_centres(patch)]
    (data / "points").write_text(foam_files.numbers(centres) + "\n", encoding="ascii")
    return data


def pressure_points(mesh: Mesh) -> Array:
    """Return the centres of the n cells on the straight walls and the slots, (n, 2)."""
    return np.vstack([mesh.centres[mesh.patch_cells[name]][_straight(mesh, name)] for name in FORCE_OBJECTS])


def sensor_weights(mesh: Mesh) -> Array:
    """Return the weights, (92, n), of the kinematic pressures at the n `pressure_points`. The first 90 weighted sums
    are Cp at the sensors. The last two are the mean Cp over each slot, weighted with the jet profile."""
    at = np.vstack([mesh.patch_centres(name)[_straight(mesh, name)] for name in FORCE_OBJECTS])
    on_base = np.abs(at[:, 0] - LENGTH) < 1e-9
    rows = []
    for x, y in sensors.TRUCK.positions:
        base = abs(x - LENGTH) < 1e-9
        along, place = (at[:, 1], y) if base else (at[:, 0], x)
        wall = on_base if base else ~on_base & (at[:, 1] * y > 0)
        rows.append(_between(along, wall, float(place)))
    for sign in (1.0, -1.0):
        slot = on_base & (sign * at[:, 1] > HALF_WIDTH - JET_WIDTH)
        weight = np.zeros(len(at))
        weight[slot] = slot_shares(int(slot.sum()))[np.argsort(np.argsort(at[slot, 1]))]
        rows.append(weight)
    return 2.0 * np.array(rows)


def slot_shares(cells: int) -> Array:
    """Return the fractions of a slot's flow through its equally long faces, (`cells`,), exact for a parabola."""
    s = np.linspace(0.0, 1.0, cells + 1)
    return np.diff(s**2 * (3.0 - 2.0 * s))


def _straight(mesh: Mesh, name: str) -> npt.NDArray[np.bool_]:
    x, y = mesh.patch_centres(name).T
    side, base = np.abs(np.abs(y) - HALF_WIDTH) < 1e-9, np.abs(x - LENGTH) < 1e-9
    return np.asarray((x > LEADING_EDGE_RADIUS) & (side | base))


def _between(along: Array, wall: npt.NDArray[np.bool_], place: float) -> Array:
    """Return weights for all faces: a linear interpolation to `place` between the two nearest faces of `wall`."""
    index = np.flatnonzero(wall)
    index = index[np.argsort(along[index])]
    i = int(np.clip(np.searchsorted(along[index], place) - 1, 0, len(index) - 2))
    low, high = index[i], index[i + 1]
    share = (place - along[low]) / (along[high] - along[low])
    weight = np.zeros(len(along))
    weight[low], weight[high] = 1.0 - share, share
    return weight


PRESSURES: Final = "wallPressures"
PROBE_OBJECT: Final = "wakeProbe"


def write_mesh(folder: Path, mesh: Mesh) -> None:
    for name in ("system", "constant/polyMesh"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    foam_files.write_poly_mesh(mesh, folder / "constant" / "polyMesh")


def write_start(folder: Path, velocity: Array, pressure: Array) -> None:
    """Write the fields at t = 0, one row for each of the m cells: velocity (m, 2) and kinematic pressure (m,)."""
    (folder / "0").mkdir(exist_ok=True)
    speeds: dict[str, dict[str, Any]] = {
        "outlet": {"type": "zeroGradient"},
        "sides": {"type": "slip"},
        "truck": {"type": "noSlip"},
        **{patch: BOUNDARY for patch in DRIVEN},
        foam_files.PLANES: {"type": "empty"},
    }
    pressures: dict[str, dict[str, Any]] = {name: {"type": "zeroGradient"} for name in PATCHES}
    pressures |= {"outlet": {"type": "fixedValue", "value": "uniform 0"}, foam_files.PLANES: {"type": "empty"}}
    _write_field(folder, "U", "volVectorField", "[0 1 -1 0 0 0 0]", foam_files.vectors(velocity), speeds)
    numbers = foam_files.numbers([f"{value:.17g}" for value in pressure])
    _write_field(folder, "p", "volScalarField", "[0 2 -2 0 0 0 0]", numbers, pressures)


def write_settings(
    folder: Path, mesh: Mesh, config: FlowConfig, *, end: float, dt: float, steps_per_write: int, steps_per_sample: int
) -> None:
    """Write all files of the case except mesh and fields. `end` and `dt` are in t_c. `steps_per_write` and
    `steps_per_sample` are the numbers of time steps between two written states and between two measurements."""
    viscosity = f"[0 2 -1 0 0 0 0] {1.0 / config.reynolds:.12g}"
    files: dict[str, dict[str, Any]] = {
        "constant/transportProperties": {"nu": viscosity},
        "system/fvSchemes": _SCHEMES,
        "system/fvSolution": _SOLVERS,
        "system/controlDict": _control(mesh, end, dt, steps_per_write, steps_per_sample),
    }
    for name, entries in files.items():
        (folder / name).write_text(foam_files.dictionary(Path(name).name, entries), encoding="ascii")


# The schemes are of second order in space and time. U is solved by a stabilised bi-conjugate gradient method, because
# Gauss-Seidel diverges with central differences once the CFL number exceeds about 2.
_SCHEMES: Final[dict[str, Any]] = {
    "ddtSchemes": {"default": "backward"},
    "gradSchemes": {"default": "Gauss linear"},
    "divSchemes": {"default": "none", "div(phi,U)": "Gauss linear"},
    "laplacianSchemes": {"default": "Gauss linear corrected"},
    "interpolationSchemes": {"default": "linear"},
    "snGradSchemes": {"default": "corrected"},
}
# Conjugate gradients with multigrid as the preconditioner take two thirds of the time that multigrid alone takes, and
# less than two thirds on finer meshes.
_MULTIGRID: Final = {"preconditioner": "GAMG", "smoother": "DICGaussSeidel", "tolerance": 1e-6, "relTol": 0}
_PRESSURE: Final = {"solver": "PCG", "preconditioner": _MULTIGRID, "tolerance": 1e-6, "relTol": 0.05}
_SOLVERS: Final[dict[str, Any]] = {
    "solvers": {
        "p": _PRESSURE,
        "pFinal": {**_PRESSURE, "relTol": 0},
        "U": {"solver": "PBiCGStab", "preconditioner": "DILU", "tolerance": 1e-7, "relTol": 0},
    },
    "PISO": {"nCorrectors": 2, "nNonOrthogonalCorrectors": 0},
}


def _control(mesh: Mesh, end: float, dt: float, steps_per_write: int, steps_per_sample: int) -> dict[str, Any]:
    # The function objects for forces read the entries of `execute`, and those for probes the entries of `write`.
    n = steps_per_sample
    every_sample = {"executeControl": "timeStep", "executeInterval": n, "writeControl": "timeStep", "writeInterval": n}
    forces = {
        name: {
            "type": "forces", "libs": '("libforces.so")', "patches": (patch,), "rho": "rhoInf", "rhoInf": 1,
            "CofR": (0, 0, 0), "log": False, **every_sample,
        }
        for patch, name in FORCE_OBJECTS.items()
    }  # fmt: skip
    probes = {
        name: {
            "type": "probes", "libs": '("libsampling.so")', "fields": (field,),
            "probeLocations": tuple((float(x), float(y), 0.5) for x, y in points), **every_sample,
        }
        for name, field, points in (
            (PRESSURES, "p", pressure_points(mesh)),
            (PROBE_OBJECT, "U", np.array([WAKE_PROBE])),
        )
    }  # fmt: skip
    probes[PROBE_OBJECT]["interpolationScheme"] = "cellPoint"
    return {
        "application": "icoFoam",
        "startFrom": "latestTime",
        "startTime": 0,
        "stopAt": "endTime",
        "endTime": end,
        "deltaT": dt,
        "writeControl": "timeStep",
        "writeInterval": steps_per_write,
        "purgeWrite": 2,
        "writeFormat": "binary",
        "writePrecision": 12,
        "timePrecision": 10,
        "runTimeModifiable": False,
        "functions": forces | probes,
    }


def _write_field(
    folder: Path, name: str, kind: str, dimensions: str, values: str, patches: dict[str, dict[str, Any]]
) -> None:
    item = "vector" if kind == "volVectorField" else "scalar"
    text = f"dimensions {dimensions};\ninternalField nonuniform List<{item}>\n{values}\n;\n"
    text += foam_files.block("boundaryField", patches)
    (folder / "0" / name).write_text(foam_files.document(kind, name, text), encoding="ascii")
