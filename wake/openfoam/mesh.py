"""A body-fitted mesh of the truck, one cell thick. The grid lines follow the rounded leading edges exactly.

Two structured blocks share their edges. A C-shaped block runs from the outlet along the lower side, around the front
and back along the upper side. Its lines leave the wall along the normal, and fan out from the rounded edges to the
domain's corners. A tensor-product block fills the wake between the ends of the C. Both blocks are symmetric in y.
"""

from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from contract.arrays import Array, Index
from contract.errors import ConfigError
from contract.geometry import DOMAIN_X, DOMAIN_Y, HALF_WIDTH, JET_WIDTH, LEADING_EDGE_RADIUS, LENGTH
from wake.solver.grid import graded_faces

PATCHES: Final = ("inlet", "outlet", "sides", "truck", "jetUpper", "jetLower")
"""Names of the patches of the plane mesh. The case has one more patch, of type `empty`: the planes z = 0 and z = 1."""

# Each table lists pairs (position, target spacing); the spacing is linear between the positions. The position is y in
# _FRONT and _ACROSS, x in _SIDE and _WAKE, and the distance from the wall in _NORMAL.
_FRONT: Final = ((0.0, 0.03), (0.25, 0.02), (0.382, 0.0155))
_ARC: Final = 0.0155
_SIDE: Final = (
    (0.118, 0.0155), (0.6, 0.036), (1.5, 0.07), (3.0, 0.11), (4.5, 0.12), (6.0, 0.1), (7.3, 0.034), (7.647, 0.016),
)  # fmt: skip
_WAKE: Final = ((7.647, 0.016), (7.75, 0.018), (8.3, 0.045), (9.5, 0.08), (12.0, 0.1), (23.0, 0.22))
_NORMAL: Final = ((0.0, 0.0125), (0.04, 0.0125), (0.5, 0.04), (1.0, 0.08), (2.5, 0.3), (7.0, 0.9))
_ACROSS: Final = ((0.0, 0.036), (0.25, 0.032), (0.43, 0.0125), (0.5, 0.0125))

# Distance from the wall up to which the grid lines along a rounded edge are arcs around its centre.
_ROUND_UP_TO: Final = 1.0


class Mesh:
    """A plane mesh of quadrilaterals with n vertices and m cells. A patch, or the interior, has k edges. Each vertex
    line of a patch (`lines`) contains boundary edges, and may run in either direction.

    Attributes:
        points, cells: vertices (n, 2), and vertex indices of each cell counter-clockwise (m, 4).
        edges: internal edges as vertex pairs (k, 2), sorted by `owner` and then `neighbour`.
        owner, neighbour: cells to the left and right of each internal edge, (k,); owner < neighbour.
        patches, patch_cells: edges (k, 2) of each patch, with the flow on their left, and their cells (k,).
    """

    def __init__(self, points: Array, cells: Index, lines: dict[str, list[Index]]) -> None:
        self.points, self.cells, n = points, cells, len(points)
        pairs, cell, other, code = _match(cells, n)
        mine = np.flatnonzero((other >= 0) & (cell < cell[other]))
        mine = mine[np.lexsort((cell[other[mine]], cell[mine]))]
        self.edges, self.owner, self.neighbour = pairs[mine], cell[mine], cell[other[mine]]
        outside = np.flatnonzero(other < 0)
        self.patches, self.patch_cells = dict[str, Index](), dict[str, Index]()
        for name in PATCHES:
            ends = np.vstack([np.column_stack([line[:-1], line[1:]]) for line in lines[name]])
            codes = np.concatenate([ends @ np.array([n, 1]), ends @ np.array([1, n])])
            faces = outside[np.isin(code[outside], codes)]
            faces = faces[np.argsort(cell[faces], kind="stable")]
            self.patches[name], self.patch_cells[name] = pairs[faces], cell[faces]
        assert sum(map(len, self.patches.values())) == len(outside), "every boundary edge belongs to one patch"

    @property
    def centres(self) -> Array:
        """Centroids of the cells, (m, 2)."""
        x, y = np.moveaxis(self.points[self.cells], 2, 0)
        cross = x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y
        moments = [((v + np.roll(v, -1, axis=1)) * cross).sum(axis=1) for v in (x, y)]
        return np.asarray(np.column_stack(moments) / (3.0 * cross.sum(axis=1))[:, None])

    def patch_centres(self, name: str) -> Array:
        """Return the midpoints of a patch's edges, (k, 2)."""
        return np.asarray(self.points[self.patches[name]].mean(axis=1))


def truck_mesh(refinement: float = 1.0) -> Mesh:
    """Build the mesh. All spacings are divided by `refinement`. Raises ConfigError if a slot has fewer than 2 cells."""
    slot_cells = len(graded_faces(_ACROSS, HALF_WIDTH - JET_WIDTH, HALF_WIDTH, refinement)) - 1
    if slot_cells < 2:
        raise ConfigError(f"refinement = {refinement}: a slot has {slot_cells} cells, but needs at least 2")
    wake_x = graded_faces(_WAKE, LENGTH, DOMAIN_X[1], refinement)
    around, body = _around(refinement, wake_x)
    across = _across(refinement)

    # The points of the block around the body are followed by the wake block's points that are not on a shared edge.
    columns, rows = around.shape[:2]
    ring = np.arange(columns * rows).reshape(columns, rows)
    inner = np.arange(len(wake_x) * (len(across) - 2)).reshape(len(wake_x), -1) + ring.size
    tail = np.column_stack([ring[: len(wake_x), 0][::-1], inner, ring[-len(wake_x) :, 0]])
    core = np.stack(np.meshgrid(wake_x, across[1:-1], indexing="ij"), axis=-1)
    points = np.vstack([around.reshape(-1, 2), core.reshape(-1, 2)])
    # The lines around the body run from the outlet's lower part to its upper part, so that the flow is on their left.
    cells = np.vstack([_quads(ring), _quads(tail)])
    cells = cells[_renumbering(cells, len(points))]

    base, outer = tail[0], ring[:, -1]
    at_inlet = np.flatnonzero(np.abs(points[outer, 0] - DOMAIN_X[0]) < 1e-9)
    patches = {
        "inlet": [outer[at_inlet[0] : at_inlet[-1] + 1]],
        "outlet": [ring[0], ring[-1], tail[-1]],
        "sides": [outer[: at_inlet[0] + 1], outer[at_inlet[-1] :]],
        "truck": [ring[body, 0], base[slot_cells : len(base) - slot_cells]],
        "jetUpper": [base[-1 - slot_cells :]],
        "jetLower": [base[: slot_cells + 1]],
    }
    return Mesh(points, cells, patches)


def _around(refinement: float, wake_x: Array) -> tuple[Array, slice]:
    """Return the points of the block around the body, (along, away, 2), and the slice of its columns at the body."""
    flat, r = HALF_WIDTH - LEADING_EDGE_RADIUS, LEADING_EDGE_RADIUS
    front = graded_faces(_FRONT, 0.0, flat, refinement)
    # The arc has an even number of cells, so that its middle line ends in the domain's corner.
    arc = np.linspace(np.pi, 0.5 * np.pi, 2 * max(2, round(0.25 * np.pi * r * refinement / _ARC)) + 1)
    side = graded_faces(_SIDE, r, LENGTH, refinement)
    away = graded_faces(_NORMAL, 0.0, DOMAIN_Y[1] - HALF_WIDTH, refinement)
    far = away[-1] + r

    # A line from the rounded edge to the boundary is longer by `extra` than the distance from wall to boundary. A
    # quadratic function spreads the length `extra` smoothly over the points beyond `_ROUND_UP_TO`.
    extra = far * (1.0 / np.maximum(-np.cos(arc), np.sin(arc)) - 1.0)
    share = (np.maximum(away - _ROUND_UP_TO, 0.0) / (away[-1] - _ROUND_UP_TO)) ** 2
    radius = r + away[None, :] + extra[:, None] * share[None, :]
    upper = [
        _grid(-away, front[:, None]),
        _grid(r + radius * np.cos(arc)[:, None], flat + radius * np.sin(arc)[:, None])[1:],
        _grid(np.append(side, wake_x[1:])[:, None], HALF_WIDTH + away)[1:],
    ]
    half = np.concatenate(upper)
    # The first and the last line of the fan are set, bit for bit, to the straight lines next to the fan.
    half[len(front) - 1] = _grid(-away, flat)
    half[len(front) + len(arc) - 2] = _grid(r, HALF_WIDTH + away)
    whole = np.concatenate([half[:0:-1] * (1.0, -1.0), half])
    return whole, slice(len(wake_x) - 1, len(whole) - len(wake_x) + 1)


def _across(refinement: float) -> Array:
    slot = HALF_WIDTH - JET_WIDTH
    middle, edge = (graded_faces(_ACROSS, *span, refinement=refinement) for span in ((0.0, slot), (slot, HALF_WIDTH)))
    half = np.concatenate([middle, edge[1:]])
    return np.concatenate([-half[:0:-1], half])


def _grid(x: npt.ArrayLike, y: npt.ArrayLike) -> Array:
    return np.stack(np.broadcast_arrays(x, y), axis=-1).astype(np.float64)


def _quads(block: Index) -> Index:
    """Return the cells of a block of vertices (i, j), counter-clockwise if direction j is to the left of i."""
    corners = (block[:-1, :-1], block[1:, :-1], block[1:, 1:], block[:-1, 1:])
    return np.stack([corner.ravel() for corner in corners], axis=1)


def _match(cells: Index, n: int) -> tuple[Index, Index, Index, Index]:
    """Return four arrays with an entry for each edge of each cell: the edge's vertex pair, with the cell on its left;
    the cell; the index of the entry for the same edge in the neighbouring cell, or -1 at a boundary; and an integer
    that identifies the vertex pair."""
    pairs = np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2)
    cell = np.repeat(np.arange(len(cells)), 4)
    code, reverse = pairs @ np.array([n, 1]), pairs @ np.array([1, n])
    order = np.argsort(code)
    place = np.minimum(np.searchsorted(code, reverse, sorter=order), len(code) - 1)
    other = np.where(code[order[place]] == reverse, order[place], -1)
    return pairs, cell, other, code


def _renumbering(cells: Index, n: int) -> Index:
    """Order the cells so that neighbours have close numbers, for OpenFOAM's smoothers and the processor's caches."""
    _, cell, other, _ = _match(cells, n)
    inside = other >= 0
    a, b = cell[inside], cell[other[inside]]
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(len(cells), len(cells))).tocsr()
    return np.asarray(reverse_cuthill_mckee(graph, symmetric_mode=True), dtype=np.int64)
