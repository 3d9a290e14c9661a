"""Direct solver for the pressure increment on the stretched grid, links through the body cut.

The integrated five-point Laplacian A (Neumann on three sides, phi = 0 at the outlet) is separable: eigenvectors in y,
a tridiagonal system in x per eigenvector. The body enters as a low-rank change: A' = A + D K D^T, where the columns
of D are the links between a fluid and a solid cell and K their conductances, hence (Woodbury)

    phi = A^-1 (b - D (K^-1 + D^T A^-1 D)^-1 D^T A^-1 b).

Grid and body are symmetric in y, so even and odd right-hand sides are solved apart on the lower half: half the
arithmetic, and a symmetric flow stays symmetric to the bit.

Work arrays are kept. Allocated in every step they can cost as much as everything else: in a worker's thread the C
library may hand such blocks back to the system each time, and every page of them is faulted in again.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.linalg import eigh

from contract.arrays import Array
from wake.solver.grid import Grid

Links = npt.NDArray[np.int64]
Factors = tuple[Array, Array, Array, Array, Links, Array]
Work = tuple[Array, Array, Array, Array]


@dataclass(frozen=True, kw_only=True, eq=False)
class HalfSolver:
    """One parity. With h = ny/2 rows and m cut links of the lower half.

    Attributes:
        q: eigenvectors of the y-operator in columns, (h, h), normalised with the cell heights.
        qt: their transpose, contiguous.
        pivot: reciprocal pivots of the tridiagonal systems, (nx, h).
        coupling: conductance per unit height between columns i - 1 and i, (nx,).
        links: cells (i1, j1, i2, j2) either side of each cut link, (m, 4).
        capacitance: (K^-1 + D^T A^-1 D)^-1, (m, m).
        work: three arrays (nx, h) and one (m,), overwritten by every solve.
    """

    q: Array
    qt: Array
    pivot: Array
    coupling: Array
    links: Links
    capacitance: Array
    work: Work

    def arrays(self) -> Factors:
        return self.q, self.qt, self.pivot, self.coupling, self.links, self.capacitance


@dataclass(frozen=True, kw_only=True, eq=False)
class PoissonSolver:
    """Both parities."""

    even: HalfSolver
    odd: HalfSolver

    def solve(self, b: Array) -> Array:
        """phi with A' phi = b; b (nx, ny) is integrated over cells and zero in solid cells."""
        phi = np.empty_like(b)
        self.solve_into(b, phi)
        return phi

    def solve_into(self, b: Array, phi: Array) -> None:
        """The same into an existing array."""
        _solve(b, phi, self.even.arrays(), self.odd.arrays(), self.even.work, self.odd.work)


def build(grid: Grid, fluid: npt.NDArray[np.bool_]) -> PoissonSolver:
    """Factorise for a grid and a fluid mask (nx, ny), both symmetric in y."""
    if not np.array_equal(fluid, fluid[:, ::-1]) or fluid.shape[1] % 2:
        raise ValueError("the Poisson solver needs an even number of rows and a body symmetric in y")
    return PoissonSolver(even=_build_half(grid, fluid, even=True), odd=_build_half(grid, fluid, even=False))


def _build_half(grid: Grid, fluid: npt.NDArray[np.bool_], *, even: bool) -> HalfSolver:
    nx, ny = grid.shape
    h = ny // 2
    dy = grid.dy[:h]
    conductance = 1.0 / grid.dyc[1:h]
    operator = np.zeros((h, h))
    rows = np.arange(h - 1)
    operator[rows, rows + 1] = operator[rows + 1, rows] = conductance
    operator[rows, rows] -= conductance
    operator[rows + 1, rows + 1] -= conductance
    if not even:
        operator[-1, -1] -= 2.0 / grid.dyc[h]  # phi changes sign across the axis
    eigenvalues, q = eigh(operator, np.diag(dy))

    coupling = 1.0 / grid.dxc
    coupling[0] = 0.0
    diagonal = -(coupling[:-1] + coupling[1:])[:, None] + grid.dx[:, None] * eigenvalues
    pivot = np.empty((nx, h))
    pivot[0] = 1.0 / diagonal[0]
    for i in range(1, nx):
        pivot[i] = 1.0 / (diagonal[i] - coupling[i] ** 2 * pivot[i - 1])

    links, stiffness = _cut_links(grid, fluid, h)
    if even and len(links):
        # The body's inside must not float: with phi even it stays tied to the fluid through one link, which
        # carries no flux because nothing in there is a source.
        links, stiffness = links[1:], stiffness[1:]
    q = np.ascontiguousarray(q)
    qt = np.ascontiguousarray(q.T)
    capacitance = _capacitance(q, qt, pivot, coupling[:nx].copy(), links, stiffness)
    half = (nx, h)
    return HalfSolver(
        q=q,
        qt=qt,
        pivot=pivot,
        coupling=coupling[:nx].copy(),
        links=links,
        capacitance=capacitance,
        work=(np.empty(half), np.empty(half), np.empty(half), np.empty(len(links))),
    )


def _cut_links(grid: Grid, fluid: npt.NDArray[np.bool_], h: int) -> tuple[Links, Array]:
    """Links between a fluid and a solid cell in the lower half, and their conductances."""
    half = fluid[:, :h]
    i, j = np.nonzero(half[1:] != half[:-1])
    across_x = np.column_stack([i, j, i + 1, j])
    stiff_x = grid.dy[j] / grid.dxc[i + 1]
    i, j = np.nonzero(half[:, 1:] != half[:, :-1])
    across_y = np.column_stack([i, j, i, j + 1])
    stiff_y = grid.dx[i] / grid.dyc[j + 1]
    return np.vstack([across_x, across_y]).astype(np.int64), np.concatenate([stiff_x, stiff_y])


def _capacitance(q: Array, qt: Array, pivot: Array, coupling: Array, links: Links, stiffness: Array) -> Array:
    count = len(links)
    matrix = np.empty((count, count))
    spectral = np.empty_like(pivot)
    for column in range(count):
        spectral[:] = 0.0
        unit = np.zeros(count)
        unit[column] = 1.0
        _scatter(spectral, links, unit, q)
        _tridiagonal(spectral, pivot, coupling)
        _gather(spectral, links, q, matrix[:, column])
    matrix[np.diag_indices(count)] += 1.0 / stiffness
    return np.ascontiguousarray(np.linalg.inv(0.5 * (matrix + matrix.T)))


@njit(cache=True, fastmath={"contract"})
def _tridiagonal(b: Array, pivot: Array, coupling: Array) -> None:
    """Solve in place for every eigenvector at once; b is (nx, h) in spectral space."""
    nx, h = b.shape
    for k in range(h):
        b[0, k] *= pivot[0, k]
    for i in range(1, nx):
        c = coupling[i]
        for k in range(h):
            b[i, k] = (b[i, k] - c * b[i - 1, k]) * pivot[i, k]
    for i in range(nx - 2, -1, -1):
        c = coupling[i + 1]
        for k in range(h):
            b[i, k] -= c * pivot[i, k] * b[i + 1, k]


@njit(cache=True, fastmath={"contract", "reassoc"})
def _gather(spectral: Array, links: Links, q: Array, out: Array) -> None:
    """out = D^T phi for phi given in spectral space."""
    h = q.shape[0]
    for m in range(links.shape[0]):
        i1, j1, i2, j2 = links[m, 0], links[m, 1], links[m, 2], links[m, 3]
        total = 0.0
        for k in range(h):
            total += spectral[i2, k] * q[j2, k] - spectral[i1, k] * q[j1, k]
        out[m] = total


@njit(cache=True, fastmath={"contract"})
def _scatter(spectral: Array, links: Links, y: Array, q: Array) -> None:
    """Add D y to a right-hand side in spectral space."""
    h = q.shape[0]
    for m in range(links.shape[0]):
        i1, j1, i2, j2 = links[m, 0], links[m, 1], links[m, 2], links[m, 3]
        for k in range(h):
            spectral[i2, k] += y[m] * q[j2, k]
            spectral[i1, k] -= y[m] * q[j1, k]


@njit(cache=True, fastmath={"contract"})
def _solve_half(
    q: Array, qt: Array, pivot: Array, coupling: Array, links: Links, cap: Array,
    field: Array, rhs: Array, first: Array, jump: Array,
) -> None:  # fmt: skip
    """Solve in place: `field` holds the right-hand side, then phi."""
    np.dot(field, q, rhs)
    if links.shape[0] > 0:
        first[:] = rhs
        _tridiagonal(first, pivot, coupling)
        _gather(first, links, q, jump)
        _scatter(rhs, links, -np.dot(cap, jump), q)
    _tridiagonal(rhs, pivot, coupling)
    np.dot(rhs, qt, field)


@njit(cache=True, fastmath={"contract"})
def _solve(b: Array, phi: Array, even_factors: Factors, odd_factors: Factors, even_work: Work, odd_work: Work) -> None:
    nx, ny = b.shape
    h = ny // 2
    even, odd = even_work[0], odd_work[0]
    for i in range(nx):
        for j in range(h):
            even[i, j] = 0.5 * (b[i, j] + b[i, ny - 1 - j])
            odd[i, j] = 0.5 * (b[i, j] - b[i, ny - 1 - j])
    _solve_half(*even_factors, *even_work)
    _solve_half(*odd_factors, *odd_work)
    for i in range(nx):
        for j in range(h):
            phi[i, j] = even[i, j] + odd[i, j]
            phi[i, ny - 1 - j] = even[i, j] - odd[i, j]
