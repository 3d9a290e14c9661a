"""Start fields: a developed wake interpolated from the project's own solver, or from another mesh."""

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from contract.arrays import Array
from wake.openfoam.mesh import Mesh
from wake.solver.flow import Flow
from wake.solver.grid import truck_grid
from wake.truck.state import State


def from_own_solver(state: State, mesh: Mesh) -> tuple[Array, Array]:
    """Velocity (m, 2) and kinematic pressure (m,) in the mesh's cells, from a state on the grid of refinement 1.

    Linear. Cells between the outermost points and the boundary are extrapolated; the first time step removes what
    divergence interpolation has left.
    """
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
