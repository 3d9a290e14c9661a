"""An icoFoam case of the truck: schemes, solvers, boundary conditions, and function objects for measurements."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from contract.arrays import Array
from contract.config.plant import FlowConfig
from contract.geometry import WAKE_PROBE
from wake.openfoam import foam_files, wall
from wake.openfoam.mesh import PATCHES, Mesh
from wake.openfoam.wall import DRIVEN, pressure_points

FORCE_OBJECTS: Final = {"truck": "forcesTruck", "jetUpper": "forcesJetUpper", "jetLower": "forcesJetLower"}
"""Names of the function objects that measure the force on each patch, by patch."""
PRESSURES: Final = "wallPressures"
PROBE_OBJECT: Final = "wakeProbe"


@dataclass(frozen=True, kw_only=True)
class CaseClock:
    """The clock of an icoFoam run: its end and its time step, in t_c, and the numbers of time steps between written
    states and between measurements."""

    end: float
    dt: float
    steps_per_write: int
    steps_per_sample: int


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
        **{patch: wall.BOUNDARY for patch in DRIVEN},
        foam_files.PLANES: {"type": "empty"},
    }
    pressures: dict[str, dict[str, Any]] = {name: {"type": "zeroGradient"} for name in PATCHES}
    pressures |= {"outlet": {"type": "fixedValue", "value": "uniform 0"}, foam_files.PLANES: {"type": "empty"}}
    _write_field(folder, "U", "volVectorField", "[0 1 -1 0 0 0 0]", foam_files.vectors(velocity), speeds)
    _write_field(folder, "p", "volScalarField", "[0 2 -2 0 0 0 0]", foam_files.scalars(pressure), pressures)


def write_settings(folder: Path, mesh: Mesh, config: FlowConfig, clock: CaseClock) -> None:
    """Write all files of the case except mesh and fields."""
    viscosity = f"[0 2 -1 0 0 0 0] {1.0 / config.reynolds:.12g}"
    files: dict[str, dict[str, Any]] = {
        "constant/transportProperties": {"nu": viscosity},
        "system/fvSchemes": _SCHEMES,
        "system/fvSolution": _SOLVERS,
        "system/controlDict": _control(mesh, clock),
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
# Conjugate gradients with multigrid as the preconditioner take two thirds of the time of multigrid alone, and an even
# smaller share on finer meshes.
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


def _control(mesh: Mesh, clock: CaseClock) -> dict[str, Any]:
    # The function objects for forces read executeControl and executeInterval; those for probes read writeControl and
    # writeInterval. Each object gets all four entries.
    every_sample = {
        f"{what}{setting}": value
        for what in ("execute", "write")
        for setting, value in (("Control", "timeStep"), ("Interval", clock.steps_per_sample))
    }
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
        "endTime": clock.end,
        "deltaT": clock.dt,
        "writeControl": "timeStep",
        "writeInterval": clock.steps_per_write,
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
