"""Where icoFoam probes the pressure, and the sensors as weighted sums of that.

The pressure on a wall face is that of its cell (zero normal gradient there), so a sensor is interpolated linearly along
the wall between the two nearest faces. The mean over a slot weighs its faces with the jet's velocity.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from contract import sensors
from contract.arrays import Array
from contract.geometry import HALF_WIDTH, JET_WIDTH, LEADING_EDGE_RADIUS, LENGTH
from wake.openfoam.mesh import Mesh

_PROBED: Final = ("truck", "jetUpper", "jetLower")


def pressure_points(mesh: Mesh) -> Array:
    """Centres of the cells on the straight walls and the slots, (n, 2)."""
    return np.vstack([mesh.centres[mesh.patch_cells[name]][_straight(mesh, name)] for name in _PROBED])


def sensor_weights(mesh: Mesh) -> Array:
    """Weights that turn kinematic pressures at `pressure_points` into Cp at the sensors and the profile-weighted mean
    Cp over the upper and the lower slot, (92, n)."""
    at = np.vstack([mesh.patch_centres(name)[_straight(mesh, name)] for name in _PROBED])
    on_base = np.abs(at[:, 0] - LENGTH) < 1e-9
    rows = []
    for x, y in sensors.positions():
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
    """Share of a slot's flow through each of its equal faces, (cells,): the exact integral of the parabola."""
    s = np.linspace(0.0, 1.0, cells + 1)
    return np.diff(s**2 * (3.0 - 2.0 * s))


def _straight(mesh: Mesh, name: str) -> npt.NDArray[np.bool_]:
    x, y = mesh.patch_centres(name).T
    side, base = np.abs(np.abs(y) - HALF_WIDTH) < 1e-9, np.abs(x - LENGTH) < 1e-9
    return np.asarray((x > LEADING_EDGE_RADIUS) & (side | base))


def _between(along: Array, wall: npt.NDArray[np.bool_], place: float) -> Array:
    """Linear interpolation between the faces of `wall` either side of `place`."""
    index = np.flatnonzero(wall)
    index = index[np.argsort(along[index])]
    i = int(np.clip(np.searchsorted(along[index], place) - 1, 0, len(index) - 2))
    low, high = index[i], index[i + 1]
    share = (place - along[low]) / (along[high] - along[low])
    weight = np.zeros(len(along))
    weight[low], weight[high] = 1.0 - share, share
    return weight
