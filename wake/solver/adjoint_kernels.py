"""Compiled inner loops of the adjoint: the transposes of `wake.solver.kernels`, linearised about a flow.

A bar marks a sensitivity: what a scalar of later flows gains per unit of a value. Each kernel takes the sensitivities
of its forward kernel's outputs and adds to those of its inputs, in the same padded arrays and over the same runs. All
but convection is linear; convection is quadratic, so a rate's transpose needs the velocity at the rate's instant and
nothing else.
"""

import numpy as np
from numba import njit

from contract.arrays import Array, Index
from wake.solver.boundary import GhostMap
from wake.solver.kernels import Domain, Fields, Rates, Runs, Spacing, Walls, advance_stage


@njit(cache=True, fastmath={"contract"})
def _add(target: Array, values: Array, scale: float) -> None:
    for k in range(target.shape[0]):
        target[k] += scale * values[k]


@njit(cache=True, fastmath={"contract"})
def _subtract_product(target: Array, weights: Array, values: Array) -> None:
    """target -= weights values."""
    for k in range(target.shape[0]):
        target[k] -= weights[k] * values[k]


@njit(cache=True, fastmath={"contract"})
def back_u_rate(bar: Fields, gained: Array, u: Array, v: Array, nu: float, spacing: Spacing, runs: Index) -> None:
    """Carry the sensitivity `gained` of du/dt on the open u-faces to u, v and p; loops as in the forward kernel."""
    dx, dxc, dy, dyc = spacing.dx, spacing.dxc, spacing.dy, spacing.dyc
    half_rdy, nu_rdy, rdyc = 0.5 / dy, nu / dy, 1.0 / dyc
    north, south = np.empty_like(dy), np.empty_like(dy)
    for r in range(runs.shape[0]):
        i, j0, n = runs[r, 0], runs[r, 1], runs[r, 2] - runs[r, 1]
        inner, wide = slice(j0 + 1, j0 + n + 1), slice(j0, j0 + n + 2)
        rdxc = 1.0 / dxc[i]
        half = 0.5 * rdxc
        diff_w, diff_e = nu / dx[i - 1] * rdxc, nu / dx[i] * rdxc
        g = gained[i, inner]
        uw, ue, bw, be = u[i - 1, inner], u[i + 1, inner], bar.u[i - 1, inner], bar.u[i + 1, inner]
        for k in range(n):
            bw[k] += g[k] * (diff_w + half * uw[k])
        for k in range(n):
            be[k] += g[k] * (diff_e - half * ue[k])
        _add(bar.p[i - 1, j0 : j0 + n], g, rdxc)
        _add(bar.p[i, j0 : j0 + n], g, -rdxc)
        left, right = 0.5 * dx[i - 1] * rdxc, 0.5 * dx[i] * rdxc
        uy, vw, ve = u[i, wide], v[i, j0 : j0 + n + 1], v[i + 1, j0 : j0 + n + 1]
        hy, ny, cy = half_rdy[j0 : j0 + n], nu_rdy[j0 : j0 + n], rdyc[j0 : j0 + n + 1]
        g_north, g_south = north[:n], south[:n]
        for k in range(n):
            g_north[k] = g[k] * (ny[k] * cy[k + 1] - hy[k] * (left * vw[k + 1] + right * ve[k + 1]))
        for k in range(n):
            g_south[k] = g[k] * (ny[k] * cy[k] + hy[k] * (left * vw[k] + right * ve[k]))
        _add(bar.u[i, j0 + 2 : j0 + n + 2], g_north, 1.0)
        _add(bar.u[i, j0 : j0 + n], g_south, 1.0)
        both, bm = diff_e + diff_w, bar.u[i, inner]
        for k in range(n):
            bm[k] -= both * g[k] + g_north[k] + g_south[k]
        for k in range(n):
            g_north[k] = hy[k] * g[k] * (uy[k + 2] - uy[k + 1])
        for k in range(n):
            g_south[k] = hy[k] * g[k] * (uy[k + 1] - uy[k])
        _add(bar.v[i, j0 + 1 : j0 + n + 1], g_north, -left)
        _add(bar.v[i + 1, j0 + 1 : j0 + n + 1], g_north, -right)
        _add(bar.v[i, j0 : j0 + n], g_south, -left)
        _add(bar.v[i + 1, j0 : j0 + n], g_south, -right)


@njit(cache=True, fastmath={"contract"})
def back_v_rate(bar: Fields, gained: Array, u: Array, v: Array, nu: float, spacing: Spacing, runs: Index) -> None:
    """Carry the sensitivity `gained` of dv/dt on the open v-faces to u, v and p."""
    dx, dxc, dy, dyc = spacing.dx, spacing.dxc, spacing.dy, spacing.dyc
    rdy, rdyc = 1.0 / dy, 1.0 / dyc
    below, above = 0.5 * dy[:-1] * rdyc[1:-1], 0.5 * dy[1:] * rdyc[1:-1]
    first, second, third = np.empty_like(dyc), np.empty_like(dyc), np.empty_like(dyc)
    for r in range(runs.shape[0]):
        i, j0, n = runs[r, 0], runs[r, 1], runs[r, 2] - runs[r, 1]
        inner, wide = slice(j0, j0 + n), slice(j0 - 1, j0 + n + 1)
        half_rdx = 0.5 / dx[i]
        diff_w, diff_e = nu / dxc[i] / dx[i], nu / dxc[i + 1] / dx[i]
        g = gained[i + 1, inner]
        vy, cy, my = v[i + 1, wide], rdyc[inner], rdy[j0 - 1 : j0 + n]
        scaled, one, two = first[:n], second[:n], third[:n]
        for k in range(n):
            scaled[k] = g[k] * cy[k]
        for k in range(n):
            one[k] = scaled[k] * (nu * my[k + 1] - 0.5 * vy[k + 2])
        for k in range(n):
            two[k] = scaled[k] * (nu * my[k] + 0.5 * vy[k])
        _add(bar.v[i + 1, j0 + 1 : j0 + n + 1], one, 1.0)
        _add(bar.v[i + 1, j0 - 1 : j0 + n - 1], two, 1.0)
        _add(bar.p[i, j0 : j0 + n], scaled, -1.0)
        _add(bar.p[i, j0 - 1 : j0 + n - 1], scaled, 1.0)
        bm = bar.v[i + 1, inner]
        for k in range(n):
            bm[k] -= nu * scaled[k] * (my[k + 1] + my[k])
        vm, vw, ve = v[i + 1, inner], v[i, inner], v[i + 2, inner]
        lo, hi = below[j0 - 1 : j0 + n - 1], above[j0 - 1 : j0 + n - 1]
        uw, ue = u[i, j0 : j0 + n + 1], u[i + 1, j0 : j0 + n + 1]
        for k in range(n):
            one[k] = g[k] * (diff_e - half_rdx * (lo[k] * ue[k] + hi[k] * ue[k + 1]))
        for k in range(n):
            two[k] = g[k] * (diff_w + half_rdx * (lo[k] * uw[k] + hi[k] * uw[k + 1]))
        _add(bar.v[i + 2, inner], one, 1.0)
        _add(bar.v[i, inner], two, 1.0)
        for k in range(n):
            bm[k] -= one[k] + two[k]
        for k in range(n):
            one[k] = half_rdx * g[k] * (ve[k] - vm[k])
        for k in range(n):
            two[k] = half_rdx * g[k] * (vm[k] - vw[k])
        _subtract_product(bar.u[i + 1, j0 : j0 + n], lo, one)
        _subtract_product(bar.u[i + 1, j0 + 1 : j0 + n + 1], hi, one)
        _subtract_product(bar.u[i, j0 : j0 + n], lo, two)
        _subtract_product(bar.u[i, j0 + 1 : j0 + n + 1], hi, two)


@njit(cache=True)
def _back_ghosts(flat: Array, ghosts: GhostMap) -> None:
    target, start, source, weight = ghosts.target, ghosts.start, ghosts.source, ghosts.weight
    for k in range(target.shape[0]):
        bar = flat[target[k]]
        flat[target[k]] = 0.0
        for e in range(start[k], start[k + 1]):
            flat[source[e]] += weight[e] * bar


@njit(cache=True)
def back_walls(u: Array, v: Array, walls: Walls) -> None:
    """Transpose of `fill_walls`."""
    _back_ghosts(u.reshape(-1), walls.u)
    _back_ghosts(v.reshape(-1), walls.v)


@njit(cache=True)
def back_edges(u: Array, v: Array) -> None:
    """Transpose of `fill_edges`."""
    nx, ny = u.shape[0] - 2, u.shape[1] - 2
    for j in range(ny + 1):
        v[nx, j] += v[nx + 1, j]
        v[1, j] -= v[0, j]
        v[nx + 1, j] = v[0, j] = 0.0
    for i in range(nx + 1):
        u[i, 1] += u[i, 0]
        u[i, ny] += u[i, ny + 1]
        u[i, 0] = u[i, ny + 1] = 0.0
    for j in range(ny):
        u[nx, j + 1] += u[nx + 1, j + 1]
        u[nx + 1, j + 1] = 0.0


@njit(cache=True, fastmath={"contract"})
def _back_step(q: Array, bar: Array, step: float, a: float, runs: Index, pad_i: int, pad_j: int) -> None:
    """q = a q + step bar on the open faces: what a stage's rates gain from its own step and from the next stage."""
    for r in range(runs.shape[0]):
        i, j0, j1 = runs[r, 0] + pad_i, runs[r, 1] + pad_j, runs[r, 2] + pad_j
        qi, bi = q[i, j0:j1], bar[i, j0:j1]
        for k in range(qi.shape[0]):
            qi[k] = a * qi[k] + step * bi[k]


@njit(cache=True)
def _back_stage(
    bar: Fields, slot_bar: Array, rates: Rates, u: Array, v: Array, a_next: float, step: float, domain: Domain
) -> None:
    """Transpose of a stage that began with the velocity u, v; the following one keeps `a_next` of its rates."""
    runs, slot_rows, column = domain.runs, domain.slot_rows, domain.slot_column
    back_walls(bar.u, bar.v, domain.walls)
    back_edges(bar.u, bar.v)
    for m in range(len(slot_rows)):
        slot_bar[m] = bar.u[column, slot_rows[m] + 1]
        bar.u[column, slot_rows[m] + 1] = 0.0
    bar.u[0] = 0.0
    _back_step(rates.u, bar.u, step, a_next, runs.u, 0, 1)
    _back_step(rates.v, bar.v, step, a_next, runs.v, 1, 0)
    back_u_rate(bar, rates.u, u, v, domain.viscosity, domain.spacing, runs.u)
    back_v_rate(bar, rates.v, u, v, domain.viscosity, domain.spacing, runs.v)


@njit(cache=True)
def back_stages(
    bar: Fields,
    slot_bar: Array,
    start: Fields,
    work: Fields,
    rates: Rates,
    second: Rates,
    a: Array,
    step: Array,
    slot_velocity: Array,
    wind: Array,
    gained: Array,
    domain: Domain,
) -> None:
    """Transpose of `wake.solver.kernels.stages` for its three stages, from the flow at the step's start.

    Args:
        bar: sensitivities behind the stages, made those before them.
        slot_bar: (3, m); receives the sensitivities of the slots' velocities at each stage's end.
        start: the flow at the step's start.
        work, rates, second: finite; overwritten.
        a, step, slot_velocity, wind, gained, domain: as in the forward kernel.
    """
    work.u[:], work.v[:], work.p[:] = start.u, start.v, start.p
    advance_stage(work, rates, a[0], step[0], slot_velocity[0], wind[0], gained[0], domain)
    second.u[:], second.v[:] = work.u, work.v
    advance_stage(work, rates, a[1], step[1], slot_velocity[1], wind[1], gained[1], domain)
    # From here on the rates hold their own sensitivities.
    _back_stage(bar, slot_bar[2], rates, work.u, work.v, 0.0, step[2], domain)
    _back_stage(bar, slot_bar[1], rates, second.u, second.v, a[2], step[1], domain)
    _back_stage(bar, slot_bar[0], rates, start.u, start.v, a[1], step[0], domain)


@njit(cache=True)
def back_divergence(bar_b: Array, u: Array, v: Array, dx: Array, dy: Array, runs: Index) -> None:
    """Transpose of `divergence`."""
    for r in range(runs.shape[0]):
        i, j0, j1 = runs[r, 0], runs[r, 1], runs[r, 2]
        width, height, b = dx[i], dy[j0:j1], bar_b[i, j0:j1]
        uw, ue, vi = u[i, j0 + 1 : j1 + 1], u[i + 1, j0 + 1 : j1 + 1], v[i + 1, j0 : j1 + 1]
        for k in range(j1 - j0):
            ue[k] += b[k] * height[k]
            uw[k] -= b[k] * height[k]
            vi[k + 1] += b[k] * width
            vi[k] -= b[k] * width


@njit(cache=True)
def back_correct(bar: Fields, phi: Array, dt: float, dxc: Array, dyc: Array, runs: Runs) -> None:
    """Transpose of `correct`: overwrites phi with its own sensitivity."""
    u, v, p, u_runs, v_runs = bar.u, bar.v, bar.p, runs.u, runs.v
    nx, ny = phi.shape
    for j in range(ny):
        p[nx - 1, j] -= p[nx, j]
        p[nx, j] = 0.0
    rdt = 1.0 / dt
    for i in range(nx):
        for j in range(ny):
            phi[i, j] = p[i, j] * rdt
    rdyc = 1.0 / dyc
    for r in range(v_runs.shape[0]):
        i, j0, j1 = v_runs[r, 0], v_runs[r, 1], v_runs[r, 2]
        vi, pi, c = v[i + 1, j0:j1], phi[i, j0 - 1 : j1], rdyc[j0:j1]
        for k in range(j1 - j0):
            pi[k + 1] -= vi[k] * c[k]
            pi[k] += vi[k] * c[k]
    rd = 1.0 / dxc[nx]
    for j in range(ny):
        phi[nx - 1, j] += u[nx, j + 1] * rd
    for r in range(u_runs.shape[0]):
        i, j0, j1 = u_runs[r, 0], u_runs[r, 1], u_runs[r, 2]
        if i == nx:
            continue
        rd = 1.0 / dxc[i]
        ui, pw, pe = u[i, j0 + 1 : j1 + 1], phi[i - 1, j0:j1], phi[i, j0:j1]
        for k in range(j1 - j0):
            pe[k] -= ui[k] * rd
            pw[k] += ui[k] * rd
