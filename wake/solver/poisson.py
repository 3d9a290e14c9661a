"""A direct solver for the pressure increment on the stretched grid, without links between fluid and solid cells.

The integrated five-point Laplacian A (Neumann on three sides, phi = 0 at the outlet) is separable: it has eigenvectors
in y, and a tridiagonal system in x for each eigenvector. The body is a low-rank change A' = A + D K D^T. The columns of
D are the links between a fluid and a solid cell, and K has their conductances. So (Woodbury)

    phi = A^-1 (b - D (K^-1 + D^T A^-1 D)^-1 D^T A^-1 b).

Grid and body are symmetric in y, so even and odd right-hand sides are solved separately on the lower half. This halves
the arithmetic, and a symmetric flow remains symmetric bit for bit.

No product uses BLAS, whose rounding depends on the number of threads. So the results of this module are equal bit for
bit with any number of threads, and in any thread. The products are as fast as with BLAS, because `_product` computes
three rows of its result at a time, the width is padded to whole vectors, and arrays are aligned to vectors.

Work arrays are allocated once. In a worker's thread, an allocation in every step can take as long as all other work,
because the C library may return the memory to the system each time.
"""

from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh_tridiagonal

from contract.arrays import Array, Precision
from wake.solver.grid import Grid
from wake.solver.kernels import compiled

Links = npt.NDArray[np.int64]

_VECTOR: Final = 64
"""Size of the widest vector registers in bytes."""


class HalfSolver:
    """The solver for one parity (even or odd in y). It has h = ny/2 rows, zero-padded to whole vectors, and m cut links
    in the lower half.

    Attributes:
        q, qt: eigenvectors of the y-operator in columns, (h, h), normalised with the cell heights; their transpose.
        pivot: reciprocal pivots of the tridiagonal systems, (nx, h).
        coupling: conductance per unit height between columns i - 1 and i, (nx,).
        links: cells (i1, j1) and (i2, j2) on the two sides of each cut link, (m, 4).
        capacitance: (K^-1 + D^T A^-1 D)^-1, (m, m).
        work: three arrays (nx, h) and two arrays (m,), overwritten by every solve.
    """

    def __init__(self, q: Array, pivot: Array, coupling: Array, links: Links, capacitance: Array) -> None:
        """Allocate the work arrays. `q` and `pivot` may be padded."""
        whole = _VECTOR // q.itemsize
        nx, h = len(pivot), -(-len(q) // whole) * whole
        self.pivot = pivot = _aligned(pivot, (nx, h))
        self.q = q = _aligned(q, (h, h))
        self.qt = _aligned(q.T, (h, h))
        self.coupling, self.links, self.capacitance = coupling, links, capacitance
        first, second, third = (_aligned(pivot, (nx, h)) for _ in range(3))
        self.work = (first, second, third, *np.empty((2, len(links)), q.dtype))

    def __reduce__(self) -> tuple[Any, ...]:
        # A copy is built from its arguments, so that it has its own work arrays and is aligned.
        return HalfSolver, (self.q, self.pivot, self.coupling, self.links, self.capacitance)


class PoissonSolver:
    """A solver for a grid and a fluid mask (nx, ny), both symmetric in y. It combines a solver for the even part and a
    solver for the odd part, which are built in double precision."""

    def __init__(self, grid: Grid, fluid: npt.NDArray[np.bool_], precision: Precision = np.float64) -> None:
        if not np.array_equal(fluid, fluid[:, ::-1]) or fluid.shape[1] % 2:
            raise ValueError("the Poisson solver needs an even number of rows and a body symmetric in y")
        self.even, self.odd = (_build_half(grid, fluid, precision, even=even) for even in (True, False))

    def solve_into(self, b: Array, phi: Array) -> None:
        """Set phi so that A' phi = b; b (nx, ny) is integrated over cells and zero in solid cells."""
        # The two halves are separate compiled calls, because one compiled function for both is slower.
        even, odd = self.even.work[0], self.odd.work[0]
        _split(b, even, odd)
        for half in (self.even, self.odd):
            _solve_half(half.q, half.qt, half.pivot, half.coupling, half.links, half.capacitance, *half.work)
        _join(even, odd, phi)


def _build_half(grid: Grid, fluid: npt.NDArray[np.bool_], precision: Precision, *, even: bool) -> HalfSolver:
    nx, ny = grid.shape
    h = ny // 2
    # The unknowns are scaled, because cells have unequal heights and the operator must be symmetric.
    scale = 1.0 / np.sqrt(grid.dy[:h])
    conductance = 1.0 / grid.dyc[1:h]
    sums = np.zeros(h)
    sums[:-1] -= conductance
    sums[1:] -= conductance
    if not even:
        sums[-1] -= 2.0 / grid.dyc[h]  # phi changes sign across the axis
    beside = conductance * scale[:-1] * scale[1:]
    # This LAPACK driver uses unblocked QL iterations, which call no BLAS product.
    eigenvalues, q = eigh_tridiagonal(sums * scale * scale, beside, lapack_driver="stev")
    q = scale[:, None] * q

    coupling = 1.0 / grid.dxc
    coupling[0] = 0.0
    diagonal = -(coupling[:-1] + coupling[1:])[:, None] + grid.dx[:, None] * eigenvalues
    pivot = np.empty((nx, h))
    pivot[0] = 1.0 / diagonal[0]
    for i in range(1, nx):
        pivot[i] = 1.0 / (diagonal[i] - coupling[i] ** 2 * pivot[i - 1])

    links, stiffness = _cut_links(grid, fluid, h)
    if even and len(links):
        # For even phi, the system would be singular if the body's inside were not connected to the fluid. So one link
        # to the fluid is not cut. This link carries no flux, because the body contains no source.
        links, stiffness = links[1:], stiffness[1:]
    coupling = coupling[:nx].copy()
    capacitance = _capacitance(q, pivot, coupling, links, stiffness)
    q, pivot, coupling, capacitance = (each.astype(precision) for each in (q, pivot, coupling, capacitance))
    return HalfSolver(q, pivot, coupling, links, capacitance)


def _cut_links(grid: Grid, fluid: npt.NDArray[np.bool_], h: int) -> tuple[Links, Array]:
    """Return the links between a fluid and a solid cell in the lower half, and their conductances."""
    half = fluid[:, :h]
    i, j = np.nonzero(half[1:] != half[:-1])
    across_x = np.column_stack([i, j, i + 1, j])
    stiff_x = grid.dy[j] / grid.dxc[i + 1]
    i, j = np.nonzero(half[:, 1:] != half[:, :-1])
    across_y = np.column_stack([i, j, i, j + 1])
    stiff_y = grid.dx[i] / grid.dyc[j + 1]
    return np.vstack([across_x, across_y]).astype(np.int64), np.concatenate([stiff_x, stiff_y])


def _capacitance(q: Array, pivot: Array, coupling: Array, links: Links, stiffness: Array) -> Array:
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
    return _inverse(0.5 * (matrix + matrix.T))


def _aligned(values: Array, shape: tuple[int, int]) -> Array:
    """Return a copy that is aligned to vector registers and padded by zeros to a shape."""
    room = np.zeros(shape[0] * shape[1] + _VECTOR // values.itemsize, values.dtype)
    begin = -room.ctypes.data % _VECTOR // room.itemsize
    copy = room[begin : begin + shape[0] * shape[1]].reshape(shape)
    copy[: values.shape[0], : values.shape[1]] = values
    return copy


def _inverse(matrix: Array) -> Array:
    """Invert a positive definite matrix in place by Gauss-Jordan elimination; such a matrix needs no pivoting."""
    for k in range(len(matrix)):
        row, column = matrix[k] / matrix[k, k], matrix[:, k].copy()
        matrix -= np.outer(column, row)
        matrix[k], matrix[:, k] = row, -column / column[k]
        matrix[k, k] = 1.0 / column[k]
    return matrix


@compiled("contract")
def _tridiagonal(b: Array, pivot: Array, coupling: Array) -> None:
    """Solve the tridiagonal systems of all eigenvectors in place; b is (nx, h) in spectral space."""
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


@compiled("contract", "reassoc")
def _gather(spectral: Array, links: Links, q: Array, out: Array) -> None:
    """Compute out = D^T phi for phi in spectral space."""
    h = q.shape[0]
    for m in range(links.shape[0]):
        i1, j1, i2, j2 = links[m, 0], links[m, 1], links[m, 2], links[m, 3]
        total = q.dtype.type(0.0)
        for k in range(h):
            total += spectral[i2, k] * q[j2, k] - spectral[i1, k] * q[j1, k]
        out[m] = total


@compiled("contract")
def _scatter(spectral: Array, links: Links, y: Array, q: Array) -> None:
    """Add D y to a right-hand side in spectral space."""
    h = q.shape[0]
    for m in range(links.shape[0]):
        i1, j1, i2, j2 = links[m, 0], links[m, 1], links[m, 2], links[m, 3]
        for k in range(h):
            spectral[i2, k] += y[m] * q[j2, k]
            spectral[i1, k] -= y[m] * q[j1, k]


@compiled("contract")
def _product(a: Array, b: Array, out: Array) -> None:
    """Compute `out = a @ b` for b (h, h), where h is a multiple of 4. The loop computes three rows of the result at a
    time, and adds four terms of their sums at once, in a fixed order, so that the grouping of rows has no effect."""
    n, h = out.shape
    for i in range(0, n - 2, 3):
        a0, a1, a2 = a[i], a[i + 1], a[i + 2]
        out0, out1, out2 = out[i], out[i + 1], out[i + 2]
        for j in range(h):
            out0[j] = out1[j] = out2[j] = 0.0
        for k in range(0, h, 4):
            p0, p1, p2, p3 = a0[k], a0[k + 1], a0[k + 2], a0[k + 3]
            q0, q1, q2, q3 = a1[k], a1[k + 1], a1[k + 2], a1[k + 3]
            r0, r1, r2, r3 = a2[k], a2[k + 1], a2[k + 2], a2[k + 3]
            b0, b1, b2, b3 = b[k], b[k + 1], b[k + 2], b[k + 3]
            for j in range(h):
                x0, x1, x2, x3 = b0[j], b1[j], b2[j], b3[j]
                out0[j] = (((out0[j] + p0 * x0) + p1 * x1) + p2 * x2) + p3 * x3
                out1[j] = (((out1[j] + q0 * x0) + q1 * x1) + q2 * x2) + q3 * x3
                out2[j] = (((out2[j] + r0 * x0) + r1 * x1) + r2 * x2) + r3 * x3
    for i in range(n - n % 3, n):
        out[i] = 0.0
        for k in range(h):
            for j in range(h):
                out[i, j] += a[i, k] * b[k, j]


@compiled("contract", "reassoc")
def _times(matrix: Array, vector: Array, out: Array) -> None:
    """Compute `out = -matrix @ vector`."""
    for i in range(matrix.shape[0]):
        row, total = matrix[i], matrix.dtype.type(0.0)
        for k in range(row.shape[0]):
            total += row[k] * vector[k]
        out[i] = -total


@compiled("contract")
def _solve_half(
    q: Array, qt: Array, pivot: Array, coupling: Array, links: Links, cap: Array,
    field: Array, rhs: Array, first: Array, jump: Array, against: Array,
) -> None:  # fmt: skip
    """Solve in place: `field` holds the right-hand side before the call, and phi after the call."""
    _product(field, q, rhs)
    if links.shape[0] > 0:
        for i in range(rhs.shape[0]):
            for k in range(rhs.shape[1]):
                first[i, k] = rhs[i, k]
        _tridiagonal(first, pivot, coupling)
        _gather(first, links, q, jump)
        _times(cap, jump, against)
        _scatter(rhs, links, against, q)
    _tridiagonal(rhs, pivot, coupling)
    _product(rhs, qt, field)


@compiled("contract")
def _split(b: Array, even: Array, odd: Array) -> None:
    """Compute the even and the odd part of b, on the lower half."""
    half = b.dtype.type(0.5)
    nx, h, last = b.shape[0], b.shape[1] // 2, np.uintp(b.shape[1] // 2 - 1)
    for i in range(nx):
        lower, upper, even_i, odd_i = b[i, :h], b[i, h:], even[i], odd[i]
        # A negative index would count from the end. An unsigned index prevents this, so the compiler can vectorise.
        for j in range(np.uintp(h)):
            even_i[j] = half * (lower[j] + upper[last - j])
        for j in range(np.uintp(h)):
            odd_i[j] = half * (lower[j] - upper[last - j])
        # The padding is also cleared, because a diverged flow leaves non-finite values there.
        even_i[h:] = odd_i[h:] = half * 0


@compiled("contract")
def _join(even: Array, odd: Array, phi: Array) -> None:
    """Compute phi on the whole grid from its even and odd parts on the lower half."""
    nx, h, last = phi.shape[0], phi.shape[1] // 2, np.uintp(phi.shape[1] // 2 - 1)
    for i in range(nx):
        lower, upper, even_i, odd_i = phi[i, :h], phi[i, h:], even[i], odd[i]
        for j in range(np.uintp(h)):
            lower[j] = even_i[j] + odd_i[j]
        for j in range(np.uintp(h)):
            upper[last - j] = even_i[j] - odd_i[j]
