"""A stretched tensor grid around a box such as the truck, with faces on every straight wall and slot edge.

The grid is staggered: p is in cell centres (nx, ny), u on x-faces (nx + 1, ny), v on y-faces (nx, ny + 1). The grid is
symmetric in y and has an even number of rows, so that the flow splits exactly into an even and an odd part.

A flow's buffer holds u, v and p one after another, each in rows along y and padded for the stencils. u (nx + 2, ny + 2)
has one layer beyond each side and one beyond the outlet. v (nx + 2, ny + 1) has one layer before the inlet and one
beyond the outlet. p (nx + 1, ny) has one layer beyond the outlet. Unpadded indices (i, j) are the grid's indices.
"""

from collections.abc import Sequence
from math import prod
from typing import Any, Literal, NamedTuple

import numpy as np

from contract.arrays import Array, Precision
from contract.errors import ConfigError
from contract.geometry import DOMAIN_X, DOMAIN_Y, HALF_WIDTH, JET_WIDTH, LENGTH

Component = Literal["u", "v", "p"]

_Spacing = tuple[tuple[float, float], ...]
"""Pairs (position, target cell size). The size is linear between the positions and constant outside them."""

# The wall cells are as large as the wall cells of the body-fitted reference mesh (0.0125 W, 4 cells per slot). Sides
# and wake are as fine as the finest regions of that mesh. Along x there are two tables, for positions relative to the
# nose and to the base; on the body the smaller spacing applies.
_FROM_NOSE: _Spacing = (
    (-7.0, 0.6), (-1.0, 0.1), (-0.05, 0.0125), (0.15, 0.0125), (1.0, 0.04), (2.0, 0.06), (4.5, 0.09),
)  # fmt: skip
_FROM_BASE: _Spacing = (
    (-3.147, 0.09), (-0.647, 0.05), (-0.047, 0.016), (0.103, 0.016), (0.553, 0.03), (1.353, 0.045), (4.353, 0.06),
    (15.353, 0.12),
)  # fmt: skip
_SPACING_Y: _Spacing = (
    (0.0, 0.03), (0.42, 0.0125), (0.58, 0.0125), (1.5, 0.075), (3.0, 0.2), (7.5, 0.8),
)  # fmt: skip


class Grid:
    """The coordinates of the faces, and the spacings derived from these coordinates, for nx by ny cells. Only `xf`
    and `yf` are needed without a body.

    Attributes:
        xf, yf, xc, yc: coordinates of the faces, (nx + 1,) and (ny + 1,), and of the cell centres, (nx,) and (ny,).
        dxc, dyc: distances between the centres on both sides of each face, shapes (nx + 1,) and (ny + 1,). The first
            and the last distance are half a cell.
        front, rear, lower, upper: face indices of the body's front and base, and of its sides.
        slot_cells: number of cells across each slot.
    """

    def __init__(
        self, xf: Array, yf: Array, front: int = 0, rear: int = 0, lower: int = 0, upper: int = 0, slot_cells: int = 0
    ) -> None:
        self.xf, self.yf = xf, yf
        self.front, self.rear, self.lower, self.upper, self.slot_cells = front, rear, lower, upper, slot_cells
        self.xc, self.yc = 0.5 * (xf[1:] + xf[:-1]), 0.5 * (yf[1:] + yf[:-1])
        self.dx, self.dy = np.diff(xf), np.diff(yf)
        self.dxc = np.diff(np.concatenate([xf[:1], self.xc, xf[-1:]]))
        self.dyc = np.diff(np.concatenate([yf[:1], self.yc, yf[-1:]]))

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.xc), len(self.yc)

    def axes(self, component: Component) -> tuple[Array, Array]:
        """Return the coordinates x and y of the component's values."""
        return self.xf if component == "u" else self.xc, self.yf if component == "v" else self.yc


def truck_grid(refinement: float = 1.0) -> Grid:
    """Return the grid of the truck; see `box_grid`."""
    return box_grid(LENGTH, refinement)


def box_grid(length: float, refinement: float = 1.0) -> Grid:
    """Return the grid around a box of width 1 from x = 0 to `length`. The resolution at nose and base is the same for
    every box; every spacing is divided by `refinement`. Raises ConfigError if a slot has fewer than two cells."""
    # The positions are rounded, so that the truck's positions equal the tabulated positions bit for bit.
    base = tuple((round(length + offset, 9), size) for offset, size in _FROM_BASE)
    x_parts = [
        graded_faces(_FROM_NOSE, DOMAIN_X[0], 0.0, refinement),
        graded_faces(_FROM_NOSE, 0.0, length, refinement, base),
        graded_faces(base, length, DOMAIN_X[1], refinement),
    ]
    slot = HALF_WIDTH - JET_WIDTH
    y_parts = [
        graded_faces(_SPACING_Y, start, end, refinement)
        for start, end in ((0.0, slot), (slot, HALF_WIDTH), (HALF_WIDTH, DOMAIN_Y[1]))
    ]
    slot_cells = len(y_parts[1]) - 1
    if slot_cells < 2:
        raise ConfigError(
            f"refinement = {refinement:g}: a slot has {slot_cells} cells, but needs at least 2: take 0.38 or more"
        )
    half = _join(y_parts)
    yf = np.concatenate([-half[:0:-1], half])
    centre = len(half) - 1
    wall = len(y_parts[0]) + len(y_parts[1]) - 2
    nose = len(x_parts[0]) - 1
    return Grid(
        xf=_join(x_parts),
        yf=yf,
        front=nose,
        rear=nose + len(x_parts[1]) - 1,
        lower=centre - wall,
        upper=centre + wall,
        slot_cells=slot_cells,
    )


def graded_faces(spacing: _Spacing, start: float, end: float, refinement: float, *others: _Spacing) -> Array:
    """Return faces from start to end. At each position, the cell size is the smallest size in `spacing` and `others`,
    divided by `refinement`, and scaled so that a whole number of cells fits."""
    x = np.linspace(start, end, 4001)
    sizes = np.min([np.interp(x, *np.array(spacing).T) for spacing in (spacing, *others)], axis=0)
    density = refinement / sizes
    cells = np.concatenate(([0.0], np.cumsum(np.diff(x) * (density[1:] + density[:-1]) / 2.0)))
    count = max(1, round(float(cells[-1])))
    faces = np.interp(np.linspace(0.0, cells[-1], count + 1), cells, x)
    faces[0], faces[-1] = start, end
    return faces


def bilinear(x: Array, y: Array, px: float, py: float) -> list[tuple[tuple[int, int], float]]:
    """Return the nodes (i, j) of the tensor grid x, y around a point, with their weights; zero weights are left out."""
    # Python's min and max are faster here than np.clip, and building a plant calls this function 15,000 times.
    i = min(max(int(x.searchsorted(px)) - 1, 0), len(x) - 2)
    j = min(max(int(y.searchsorted(py)) - 1, 0), len(y) - 2)
    a = (px - x[i]) / (x[i + 1] - x[i])
    b = (py - y[j]) / (y[j + 1] - y[j])
    corners = (
        ((i, j), (1 - a) * (1 - b)),
        ((i + 1, j), a * (1 - b)),
        ((i, j + 1), (1 - a) * b),
        ((i + 1, j + 1), a * b),
    )
    return [(face, float(w)) for face, w in corners if abs(w) > 1e-12]


def _join(parts: Sequence[Array]) -> Array:
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])


def _padded(shape: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    nx, ny = shape
    return (nx + 2, ny + 2), (nx + 2, ny + 1), (nx + 1, ny)


class Flow(NamedTuple):
    """A buffer, `flat`, with its padded views u, v and p. In a copy, the views belong to the copy's own buffer."""

    flat: Array
    u: Array
    v: Array
    p: Array

    @classmethod
    def zeros(cls, shape: tuple[int, int], precision: Precision = np.float64) -> "Flow":
        """Return a flow of zeros on a grid of `shape` = (nx, ny) cells."""
        return cls.of(np.zeros(sum(map(prod, _padded(shape))), precision), shape)

    @classmethod
    def of(cls, flat: Array, shape: tuple[int, int]) -> "Flow":
        """Return a flow whose arrays are views of an existing buffer."""
        shapes = _padded(shape)
        parts = np.split(flat, np.cumsum([prod(each) for each in shapes[:-1]]))
        return cls(flat, *(part.reshape(each) for part, each in zip(parts, shapes, strict=True)))

    @classmethod
    def numbered(cls, shape: tuple[int, int]) -> "Flow":
        """Return a flow in which each value is its own index in the buffer."""
        return cls.of(np.arange(cls.zeros(shape).flat.size, dtype=np.float64), shape)

    def __reduce__(self) -> tuple[Any, ...]:
        return Flow.of, (self.flat, self.cells_p.shape)

    def unpadded(self, component: Component) -> Array:
        """Return the component's values on the grid's faces or in its cells, a view."""
        return {"u": self.faces_u, "v": self.faces_v, "p": self.cells_p}[component]

    @property
    def faces_u(self) -> Array:
        """u on the x-faces, (nx + 1, ny); a view."""
        return self.u[:-1, 1:-1]

    @property
    def faces_v(self) -> Array:
        """v on the y-faces, (nx, ny + 1); a view."""
        return self.v[1:-1]

    @property
    def cells_p(self) -> Array:
        """Kinematic pressure in the cells, (nx, ny); a view."""
        return self.p[:-1]

    @property
    def velocities(self) -> Array:
        """The part of the buffer that holds u and v with their padding; a flat view."""
        return self.flat[: self.u.size + self.v.size]
