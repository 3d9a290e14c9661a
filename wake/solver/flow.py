"""The buffer of velocity and pressure, and the position of each value in this buffer.

The buffer holds u, v and p one after another, each row by row in y and padded for the stencils. u (nx + 2, ny + 2) has
one layer beyond each side and one beyond the outlet. v (nx + 2, ny + 1) has one layer before the inlet and one beyond
the outlet. p (nx + 1, ny) has one layer beyond the outlet. Unpadded indices (i, j) are those of `wake.solver.grid`.
"""

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from contract.arrays import Array, Precision
from wake.solver.grid import Component

_ORDER: Final[tuple[Component, ...]] = ("u", "v", "p")
_PADDED: Final[dict[Component, tuple[int, int]]] = {"u": (2, 2), "v": (2, 1), "p": (1, 0)}
"""Difference between the padded shape and (nx, ny)."""
_FIRST: Final[dict[Component, tuple[int, int]]] = {"u": (0, 1), "v": (1, 0), "p": (0, 0)}
"""Position of the unpadded entry (0, 0) in the padded array."""


@dataclass(frozen=True)
class Layout:
    """The positions of u, v and p for a grid of `shape` = (nx, ny) cells."""

    shape: tuple[int, int]

    def padded(self, component: Component) -> tuple[int, int]:
        """Return the shape of the component's padded array."""
        (nx, ny), (more_x, more_y) = self.shape, _PADDED[component]
        return nx + more_x, ny + more_y

    def entries(self, component: Component) -> slice:
        """Return the component's part of the buffer."""
        start = sum(self._size(before) for before in _ORDER[: _ORDER.index(component)])
        return slice(start, start + self._size(component))

    @property
    def size(self) -> int:
        return sum(self._size(component) for component in _ORDER)

    def offset(self, component: Component, i: int, j: int) -> int:
        """Return the flat index of the unpadded entry (i, j) in the component's padded array."""
        first_i, first_j = _FIRST[component]
        return (i + first_i) * self.padded(component)[1] + j + first_j

    def index(self, component: Component, i: int, j: int) -> int:
        """Return the index of the unpadded entry (i, j) in the buffer."""
        return int(self.entries(component).start) + self.offset(component, i, j)

    def _size(self, component: Component) -> int:
        rows, columns = self.padded(component)
        return rows * columns


class Flow(NamedTuple):
    """A buffer, `flat`, with its padded views u, v and p. In a copy, the views belong to the copy's own buffer."""

    flat: Array
    u: Array
    v: Array
    p: Array

    @classmethod
    def zeros(cls, shape: tuple[int, int], precision: Precision = np.float64) -> "Flow":
        """Return a flow of zeros on a grid of `shape` = (nx, ny) cells."""
        return cls.of(np.zeros(Layout(shape).size, precision), shape)

    @classmethod
    def of(cls, flat: Array, shape: tuple[int, int]) -> "Flow":
        """Return a flow whose arrays are views of an existing buffer."""
        layout = Layout(shape)
        u, v, p = (flat[layout.entries(name)].reshape(layout.padded(name)) for name in _ORDER)
        return cls(flat=flat, u=u, v=v, p=p)

    def __reduce__(self) -> tuple[Any, ...]:
        more_x, more_y = _PADDED["p"]
        return Flow.of, (self.flat, (self.p.shape[0] - more_x, self.p.shape[1] - more_y))

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
