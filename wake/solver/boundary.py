"""An immersed boundary of second order: the faces that carry flow, and the velocities on the faces at the walls.

A face between two fluid cells is open: its velocity is a solution of the momentum equation. Every other face in the
stencil of an open face is a ghost. Its value comes from a parabola along the wall's normal. The parabola is zero on the
exact wall and passes through two image points in the flow, where the velocity is interpolated bilinearly between open
faces. On a wall along the grid lines, a straight line from zero on the wall to one open face replaces the parabola.

In the mass balance a ghost carries no flow, so the wall is a staircase in this balance. The method is still of second
order, because the volume flow between a no-slip wall and a nearby point grows with the square of the distance.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation

from contract.arrays import Array, Index, Mask
from wake.solver.grid import Component, Flow, Grid, bilinear

SignedDistance = Callable[[npt.ArrayLike, npt.ArrayLike], Array]

_ON_WALL = 1e-9


class GhostMap(NamedTuple):
    """A linear map to a component's ghosts. The value of ghost k is the sum of weight * value over the entries start[k]
    .. start[k + 1] - 1; `target` and `source` are flat indices of the component's padded array (`wake.solver.grid`)."""

    target: Index
    start: Index
    source: Index
    weight: Array


class Boundary:
    """The classification of a grid's cells and faces around a body. `distance` computes the distance to the wall:
    positive in the fluid, exact near the wall.

    Attributes:
        fluid: (nx, ny) the cells whose centre lies in the fluid.
        open_u, open_v: (nx + 1, ny) and (nx, ny + 1) the faces between two fluid cells or on the outlet.
        u_runs, v_runs, cell_runs: rows (i, j0, j1) that cover the open faces and the fluid cells.
        u_ghosts, v_ghosts: maps on the padded arrays u and v.
    """

    def __init__(self, grid: Grid, distance: SignedDistance) -> None:
        nx, ny = grid.shape
        self.fluid: Mask = distance(*np.meshgrid(grid.xc, grid.yc, indexing="ij")) > 0
        self.open_u, self.open_v = np.zeros((nx + 1, ny), dtype=bool), np.zeros((nx, ny + 1), dtype=bool)
        self.open_u[1:-1] = self.fluid[1:] & self.fluid[:-1]
        self.open_u[-1] = self.fluid[-1]
        self.open_v[:, 1:-1] = self.fluid[:, 1:] & self.fluid[:, :-1]
        self.u_runs, self.v_runs, self.cell_runs = map(_runs, (self.open_u, self.open_v, self.fluid))
        touched_u, touched_v = _stencil(self.open_u, self.open_v)
        self.u_ghosts = _ghosts(grid, "u", self.open_u, touched_u, distance)
        self.v_ghosts = _ghosts(grid, "v", self.open_v, touched_v, distance)


def _stencil(open_u: Mask, open_v: Mask) -> tuple[Mask, Mask]:
    """Return the faces in the momentum stencil of any open face."""
    touched_u, touched_v = binary_dilation(open_u), binary_dilation(open_v)
    for a, b in ((0, 0), (0, 1), (1, 0), (1, 1)):
        # u-face (i, j) reads the v-faces at its four corners, and a v-face reads u-faces in the same way.
        touched_v[:, a : a + open_v.shape[1] - 1] |= open_u[b : b + open_v.shape[0]]
        touched_u[a : a + open_u.shape[0] - 1] |= open_v[:, b : b + open_u.shape[1]]
    return touched_u, touched_v


def _runs(mask: Mask) -> Index:
    """Return the maximal runs of True along the second axis as rows (i, j0, j1)."""
    edges = np.diff(mask.astype(np.int8), axis=1, prepend=0, append=0)
    i0, j0 = np.nonzero(edges == 1)
    _, j1 = np.nonzero(edges == -1)
    return np.column_stack([i0, j0, j1]).astype(np.int64)


def _ghosts(grid: Grid, component: Component, open_faces: Mask, touched: Mask, distance: SignedDistance) -> GhostMap:
    (x, y), numbers = grid.axes(component), Flow.numbered(grid.shape)
    index = numbers.unpadded(component) - getattr(numbers, component)[0, 0]
    target, start, source, weight = [], [0], [], []
    for i, j in np.argwhere(touched & ~open_faces):
        at_wall = abs(float(distance(x[i], y[j]))) < _ON_WALL
        at_edge = i in (0, open_faces.shape[0] - 1) if component == "u" else j in (0, open_faces.shape[1] - 1)
        if at_wall or at_edge:
            continue  # the boundary conditions set the velocity on such faces
        target.append(index[i, j])
        for face, w in _parabola(x, y, int(i), int(j), open_faces, distance):
            source.append(index[face])
            weight.append(w)
        start.append(len(source))
    return GhostMap(np.array(target, np.int64), np.array(start, np.int64), np.array(source, np.int64), np.array(weight))


def _parabola(
    x: Array, y: Array, i: int, j: int, open_faces: Mask, distance: SignedDistance
) -> list[tuple[tuple[int, int], float]]:
    """Return open faces with weights. The weighted sum of their velocities is the velocity of the ghost (i, j)."""
    here = float(distance(x[i], y[j]))
    normal = _normal(distance, x[i], y[j])
    if min(abs(normal[0]), abs(normal[1])) < 1e-6:
        ahead = (i + round(normal[0]), j + round(normal[1]))
        there = float(distance(x[ahead[0]], y[ahead[1]]))
        if open_faces[ahead] and here < 0:
            return [(ahead, here / there)]
    spacing = float(max(*np.diff(x[i - 1 : i + 2]), *np.diff(y[j - 1 : j + 2])))

    def image(at_least: float) -> tuple[float, list[tuple[tuple[int, int], float]]]:
        """Find the nearest point on the normal that is at least `at_least` from the wall and between four open faces.
        Return the point's distance from the wall, and the four faces with weights."""
        for away in np.arange(at_least, at_least + 6.0 * spacing, 0.125 * spacing):
            step = away - here
            entries = bilinear(x, y, x[i] + step * normal[0], y[j] + step * normal[1])
            if all(open_faces[face] for face, _ in entries):
                return float(away), entries
        raise ValueError(f"no flow found along the wall normal at ({x[i]:.4f}, {y[j]:.4f}): the grid is too coarse")

    d1, first = image(0.75 * spacing)
    d2, second = image(d1 + spacing)
    w1 = here * (here - d2) / (d1 * (d1 - d2))
    w2 = here * (here - d1) / (d2 * (d2 - d1))
    return [(face, w1 * w) for face, w in first] + [(face, w2 * w) for face, w in second]


def _normal(distance: SignedDistance, px: float, py: float) -> tuple[float, float]:
    step = 1e-6
    nx = float(distance(px + step, py) - distance(px - step, py))
    ny = float(distance(px, py + step) - distance(px, py - step))
    length = float(np.hypot(nx, ny))
    return nx / length, ny / length
