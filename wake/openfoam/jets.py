"""The slots' boundary condition: a parabola in each, in opposition, between values at listed instants.

`timeVaryingMappedFixedValue` ramps linearly between instants and reads the velocity at each from a file. A case without
control lists the beginning and a time it will never reach, with jets at rest; a coupled one lists every time step's
end, and its files are named pipes.
"""

import os
from pathlib import Path
from typing import Any, Final

import numpy as np

from contract.arrays import Array
from contract.geometry import JET_WIDTH
from wake.openfoam import dictionary
from wake.openfoam.mesh import Mesh
from wake.openfoam.sensing import slot_shares

JETS: Final = ("jetUpper", "jetLower")

BOUNDARY: Final[dict[str, Any]] = {
    "type": "timeVaryingMappedFixedValue",
    "offset": (0, 0, 0),
    "setAverage": False,
    "perturb": 0,
    "mapMethod": "nearest",
    "value": "uniform (0 0 0)",
}

_NEVER: Final = "1000000"
# An instant is named this much of a time step after the step's end, so that rounding cannot put it before.
_LATE: Final = 1e-6


def slot_velocity(mesh: Mesh, jet: str, action: float) -> Array:
    """Velocity on a slot's faces in the mesh's order, (k, 2), for a jet flow rate, averaged exactly over each face; the
    lower slot blows when the upper one sucks (paper, section 2.1)."""
    y = mesh.patch_centres(jet)[:, 1]
    shares = slot_shares(len(y))[np.argsort(np.argsort(y))]
    sign = 1.0 if jet == "jetUpper" else -1.0
    speed = sign * action * shares * len(y) / JET_WIDTH
    return np.column_stack([speed, np.zeros(len(y))])


def velocities(mesh: Mesh, jet: str, action: float) -> str:
    """The same as the text of an instant's file."""
    return dictionary.vectors(slot_velocity(mesh, jet, action)) + "\n"


def pipe(folder: Path, jet: str) -> Path:
    """The named pipe of a jet in a coupled case."""
    return folder / "pipes" / jet / "U"


def write_rest(folder: Path, mesh: Mesh) -> None:
    """Instants of a case whose jets never blow."""
    for jet in JETS:
        data = _begin(folder, mesh, jet, 0.0)
        (data / _NEVER).mkdir(exist_ok=True)
        (data / _NEVER / "U").write_text(velocities(mesh, jet, 0.0), encoding="ascii")


def write_pipes(folder: Path, mesh: Mesh, *, dt: float, steps: int, action: float) -> None:
    """Instants of a coupled case: jets that start from `action`, and the end of every time step.

    The instants are links to one folder a jet, which holds its pipe.
    """
    for jet in JETS:
        data, end = _begin(folder, mesh, jet, action), pipe(folder, jet)
        end.parent.mkdir(parents=True)
        os.mkfifo(end)
        target = Path(os.path.relpath(end.parent, data))
        for step in range(1, steps + 1):
            (data / f"{(step + _LATE) * dt:.12g}").symlink_to(target)


def _begin(folder: Path, mesh: Mesh, jet: str, action: float) -> Path:
    data = folder / "constant" / "boundaryData" / jet
    (data / "0").mkdir(parents=True, exist_ok=True)
    (data / "0" / "U").write_text(velocities(mesh, jet, action), encoding="ascii")
    centres = [f"({x:.17g} {y:.17g} 0.5)" for x, y in mesh.patch_centres(jet)]
    (data / "points").write_text(dictionary.numbers(centres) + "\n", encoding="ascii")
    return data
