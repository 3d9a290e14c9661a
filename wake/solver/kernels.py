"""The compiled inner loops: momentum balance, ghosts, divergence and pressure correction.

The scheme has central differences on the staggered grid, of second order on smoothly stretched grids. The convective
term interpolates with equal weights, so it conserves kinetic energy (Verstappen and Veldman, J. Comput. Phys. 187,
2003). The term is written in advective form, which equals the flux form on a divergence-free field. The stages of a
Runge-Kutta step are not projected. The flux form would count their divergence twice and halve the stable step.

Arrays are padded as in `wake.solver.grid`; the pressure beyond the outlet is mirrored with opposite sign. A run (i, j0,
j1) stands for the faces j0 .. j1 - 1 of row i, in unpadded indices. Runs cover exactly the faces to compute, so that
loops over j need no condition.
"""

from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar, cast

import numpy as np
from numba import njit

from contract.arrays import Array, Index
from wake.solver.boundary import GhostMap
from wake.solver.grid import Flow

T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., Any])


def compiled(*fastmath: str) -> Callable[[F], F]:
    """Return a decorator that compiles a function, which then runs without Python's global interpreter lock. `fastmath`
    are LLVM's flags for floating-point operations. Compiled code is kept beside the function's file, or in the user's
    cache folder. If neither folder can be written, as in a read-only container without a home, each process compiles
    the function again."""

    def decorate(function: F) -> F:
        try:
            return cast("F", njit(cache=True, nogil=True, fastmath=set(fastmath))(function))
        except RuntimeError:  # numba found no folder for its cache
            return cast("F", njit(nogil=True, fastmath=set(fastmath))(function))

    return decorate


class Spacing(NamedTuple):
    """The spacings of `Grid`, with mirrored cells added before the inlet and beyond the outlet; dx is (nx + 1,)."""

    dx: Array
    dxc: Array
    dy: Array
    dyc: Array


class Pair(NamedTuple, Generic[T]):
    """A value for u and a value for v, such as the rows (i, j0, j1) that cover the open faces."""

    u: T
    v: T


class Domain(NamedTuple):
    """The data that do not change between steps: 1 / Re, the spacings, the rows (i, j0, j1) that cover the open faces,
    the ghosts, the velocity at the inlet (ny,) and (ny + 1,), the x-face index of the jets, and the rows of their m
    faces (m,)."""

    viscosity: float
    spacing: Spacing
    runs: Pair[Index]
    walls: Pair[GhostMap]
    inflow: Pair[Array]
    slot_column: int
    slot_rows: Index


@compiled("contract")
def u_rate(q: Array, a: float, u: Array, v: Array, p: Array, nu: float, spacing: Spacing, runs: Index) -> None:
    """Compute `q = a * q + du/dt` on the open u-faces, including the gradient of the pressure p. The compiler does not
    vectorise a loop whose indices could be negative, so rows are sliced to start at the run. Nor does it vectorise a
    loop over very many arrays, so the x- and y-terms have separate loops."""
    real = u.dtype.type
    one, two, half, nu = real(1.0), real(2.0), real(0.5), real(nu)
    a = real(a)
    dx, dxc, dy, dyc = spacing.dx, spacing.dxc, spacing.dy, spacing.dyc
    half_rdy, nu_rdy, rdyc = half / dy, nu / dy, one / dyc
    along = np.empty_like(dy)
    for r in range(runs.shape[0]):
        i, j0, n = runs[r, 0], runs[r, 1], runs[r, 2] - runs[r, 1]
        inner, wide = slice(j0 + 1, j0 + n + 1), slice(j0, j0 + n + 2)
        rdxc = one / dxc[i]
        quarter = real(0.25) * rdxc
        diff_w, diff_e = nu / dx[i - 1] * rdxc, nu / dx[i] * rdxc
        um, uw, ue = u[i, inner], u[i - 1, inner], u[i + 1, inner]
        pw, pe = p[i - 1, j0 : j0 + n], p[i, j0 : j0 + n]
        for k in range(n):
            east, west = ue[k] - um[k], um[k] - uw[k]
            along[k] = (
                diff_e * east
                - diff_w * west
                - quarter * ((two * um[k] + east) * east + (two * um[k] - west) * west)
                - (pe[k] - pw[k]) * rdxc
            )
        left, right = half * dx[i - 1] * rdxc, half * dx[i] * rdxc
        qi, uy, vw, ve = q[i, inner], u[i, wide], v[i, j0 : j0 + n + 1], v[i + 1, j0 : j0 + n + 1]
        hy, ny, cy = half_rdy[j0 : j0 + n], nu_rdy[j0 : j0 + n], rdyc[j0 : j0 + n + 1]
        for k in range(n):
            north, south = uy[k + 2] - uy[k + 1], uy[k + 1] - uy[k]
            v_north = left * vw[k + 1] + right * ve[k + 1]
            v_south = left * vw[k] + right * ve[k]
            across = ny[k] * (north * cy[k + 1] - south * cy[k]) - hy[k] * (v_north * north + v_south * south)
            qi[k] = a * qi[k] + along[k] + across


@compiled("contract")
def v_rate(q: Array, a: float, u: Array, v: Array, p: Array, nu: float, spacing: Spacing, runs: Index) -> None:
    """Compute `q = a * q + dv/dt` on the open v-faces, including the pressure gradient, with loops as in `u_rate`."""
    real = u.dtype.type
    one, half, quarter, nu, a = real(1.0), real(0.5), real(0.25), real(nu), real(a)
    dx, dxc, dy, dyc = spacing.dx, spacing.dxc, spacing.dy, spacing.dyc
    rdy, rdyc = one / dy, one / dyc
    # The control volume of a v-face is half of the cell below and half of the cell above, in these proportions.
    below, above = half * dy[:-1] * rdyc[1:-1], half * dy[1:] * rdyc[1:-1]
    along = np.empty_like(dyc)
    for r in range(runs.shape[0]):
        i, j0, n = runs[r, 0], runs[r, 1], runs[r, 2] - runs[r, 1]
        inner, wide = slice(j0, j0 + n), slice(j0 - 1, j0 + n + 1)
        half_rdx = half / dx[i]
        diff_w, diff_e = nu / dxc[i] / dx[i], nu / dxc[i + 1] / dx[i]
        vy, pi, cy, my = v[i + 1, wide], p[i, j0 - 1 : j0 + n], rdyc[inner], rdy[j0 - 1 : j0 + n]
        for k in range(n):
            north, south = vy[k + 2] - vy[k + 1], vy[k + 1] - vy[k]
            along[k] = cy[k] * (
                nu * (north * my[k + 1] - south * my[k])
                - quarter * ((vy[k + 2] + vy[k + 1]) * north + (vy[k + 1] + vy[k]) * south)
                - (pi[k + 1] - pi[k])
            )
        vm, vw, ve = v[i + 1, inner], v[i, inner], v[i + 2, inner]
        uw, ue = u[i, j0 : j0 + n + 1], u[i + 1, j0 : j0 + n + 1]
        lo, hi, qi = below[j0 - 1 : j0 + n - 1], above[j0 - 1 : j0 + n - 1], q[i + 1, inner]
        for k in range(n):
            east = (diff_e - half_rdx * (lo[k] * ue[k] + hi[k] * ue[k + 1])) * (ve[k] - vm[k])
            west = (diff_w + half_rdx * (lo[k] * uw[k] + hi[k] * uw[k + 1])) * (vm[k] - vw[k])
            qi[k] = a * qi[k] + (along[k] + east) - west


@compiled("contract")
def _add_scaled(field: Array, q: Array, scale: float, runs: Index, pad_i: int, pad_j: int) -> None:
    """Compute `field += scale * q` on the open faces."""
    scale = field.dtype.type(scale)
    for r in range(runs.shape[0]):
        i, j0, j1 = runs[r, 0] + pad_i, runs[r, 1] + pad_j, runs[r, 2] + pad_j
        fi, qi = field[i, j0:j1], q[i, j0:j1]
        for k in range(fi.shape[0]):
            fi[k] += scale * qi[k]


@compiled()
def _fill_ghosts(flat: Array, ghosts: GhostMap) -> None:
    target, start, source, weight = ghosts.target, ghosts.start, ghosts.source, ghosts.weight
    for k in range(target.shape[0]):
        total = flat.dtype.type(0.0)
        for e in range(start[k], start[k + 1]):
            total += weight[e] * flat[source[e]]
        flat[target[k]] = total


@compiled()
def fill_edges(u: Array, v: Array, inflow_v: Array) -> None:
    """Fill the padding: slip at the sides, the inflow of v at the inlet, and the outflow of u and v."""
    two = u.dtype.type(2.0)
    nx, ny = u.shape[0] - 2, u.shape[1] - 2
    for j in range(ny):
        u[nx + 1, j + 1] = u[nx, j + 1]
    for i in range(nx + 1):
        u[i, 0] = u[i, 1]
        u[i, ny + 1] = u[i, ny]
    for j in range(ny + 1):
        v[0, j] = two * inflow_v[j] - v[1, j]
        v[nx + 1, j] = v[nx, j]


@compiled()
def fill_walls(u: Array, v: Array, walls: Pair[GhostMap]) -> None:
    """Fill the ghosts so that the flow does not slip on the body."""
    _fill_ghosts(u.reshape(-1), walls.u)
    _fill_ghosts(v.reshape(-1), walls.v)


@compiled()
def clear_walls(u: Array, v: Array, walls: Pair[GhostMap]) -> None:
    """Set the ghosts to zero, because they carry no flow in the mass balance."""
    u_flat, v_flat = u.reshape(-1), v.reshape(-1)
    for k in walls.u.target:
        u_flat[k] = 0.0
    for k in walls.v.target:
        v_flat[k] = 0.0


@compiled()
def _shift(field: Array, by: float, runs: Index, pad_i: int, pad_j: int) -> None:
    """Compute `field += by` on the open faces."""
    by = field.dtype.type(by)
    for r in range(runs.shape[0]):
        i, j0, j1 = runs[r, 0] + pad_i, runs[r, 1] + pad_j, runs[r, 2] + pad_j
        for j in range(j0, j1):
            field[i, j] += by


@compiled()
def advance_stage(
    flow: Flow, rates: Pair[Array], a: float, step: float, jets: Array, wind: float, gained: float, domain: Domain
) -> None:
    """Compute `rates = a * rates + d(velocity)/dt` and `velocity += step * rates`. Then apply the boundary conditions
    at the stage's end: the velocities `jets` on the slots' faces, and `wind` in addition to the inflow. `gained` is the
    change of the wind since the stage's beginning."""
    u, v, p = flow.u, flow.v, flow.p
    runs, inflow, slot_rows = domain.runs, domain.inflow, domain.slot_rows
    u_rate(rates.u, a, u, v, p, domain.viscosity, domain.spacing, runs.u)
    v_rate(rates.v, a, u, v, p, domain.viscosity, domain.spacing, runs.v)
    _add_scaled(u, rates.u, step, runs.u, 0, 1)
    _add_scaled(v, rates.v, step, runs.v, 1, 0)
    if gained != 0.0:
        _shift(u, gained, runs.u, 0, 1)
    for j in range(len(inflow.u)):
        u[0, j + 1] = inflow.u[j] + wind
    for k in range(len(slot_rows)):
        u[domain.slot_column, slot_rows[k] + 1] = jets[k]
    fill_edges(u, v, inflow.v)
    fill_walls(u, v, domain.walls)


@compiled()
def stages(
    flow: Flow, rates: Pair[Array], a: Array, step: Array, jets: Array, wind: Array, gained: Array, domain: Domain
) -> None:
    """Run the s Runge-Kutta stages of a step. `a` and `step` are (s,). `jets` (s, m faces), `wind` (s,) and `gained`
    (s,) are the arguments of `advance_stage` for each stage. One call runs all stages, because passing the arrays takes
    a microsecond or two in each call."""
    for k in range(len(a)):
        advance_stage(flow, rates, a[k], step[k], jets[k], wind[k], gained[k], domain)


@compiled("contract")
def divergence(b: Array, u: Array, v: Array, dx: Array, dy: Array, runs: Index) -> None:
    """Set b to the net outflow of each fluid cell; b remains zero in solid cells."""
    for r in range(runs.shape[0]):
        i, j0, j1 = runs[r, 0], runs[r, 1], runs[r, 2]
        width, height = dx[i], dy[j0:j1]
        uw, ue, vi, bi = u[i, j0 + 1 : j1 + 1], u[i + 1, j0 + 1 : j1 + 1], v[i + 1, j0 : j1 + 1], b[i, j0:j1]
        for k in range(j1 - j0):
            bi[k] = (ue[k] - uw[k]) * height[k] + (vi[k + 1] - vi[k]) * width


@compiled("contract")
def correct(flow: Flow, phi: Array, dt: float, dxc: Array, dyc: Array, runs: Pair[Index]) -> None:
    """Subtract grad phi from the velocity on open faces and the outlet (phi = 0), and add phi / dt to the pressure."""
    u, v, p, u_runs, v_runs = flow.u, flow.v, flow.p, runs.u, runs.v
    one = phi.dtype.type(1.0)
    nx, ny = phi.shape
    for r in range(u_runs.shape[0]):
        i, j0, j1 = u_runs[r, 0], u_runs[r, 1], u_runs[r, 2]
        if i == nx:
            continue
        rd = one / dxc[i]
        ui, pw, pe = u[i, j0 + 1 : j1 + 1], phi[i - 1, j0:j1], phi[i, j0:j1]
        for k in range(j1 - j0):
            ui[k] -= (pe[k] - pw[k]) * rd
    rd = one / dxc[nx]
    for j in range(ny):
        u[nx, j + 1] += phi[nx - 1, j] * rd
    rdyc = one / dyc
    for r in range(v_runs.shape[0]):
        i, j0, j1 = v_runs[r, 0], v_runs[r, 1], v_runs[r, 2]
        vi, pi, c = v[i + 1, j0:j1], phi[i, j0 - 1 : j1], rdyc[j0:j1]
        for k in range(j1 - j0):
            vi[k] -= (pi[k + 1] - pi[k]) * c[k]
    rdt = one / phi.dtype.type(dt)
    for i in range(nx):
        pi, fi = p[i], phi[i]
        for j in range(ny):
            pi[j] += fi[j] * rdt
    for j in range(ny):
        p[nx, j] = -p[nx - 1, j]
