"""The adjoint of the flow solver: the exact transpose of the discrete step, except for rounding. For a scalar that
depends on later flows, the adjoint gives the sensitivities to an earlier flow and to the actions. The projection's
operator is symmetric, so solver and adjoint use the same Poisson solver.

The compiled inner loops are the transposes of `wake.solver.kernels`, linearised about a flow. The word `bar` in a name
denotes sensitivities. A sensitivity is the derivative of the scalar with respect to a value. Each kernel reads the
sensitivities to the outputs of its forward kernel, and adds the resulting terms to the sensitivities to the forward
kernel's inputs. Arrays have the same padding as the forward kernel's arrays, and loops run over the same runs of faces.
All kernels except convection are linear. Convection is quadratic, so the transpose of a rate needs the velocity at the
rate's instant, and no other values of the flow.
"""

from collections.abc import Callable

import numpy as np

from contract.arrays import Array, Index
from contract.runtime.copies import CopiedWhole
from wake.solver import kernels
from wake.solver.boundary import GhostMap
from wake.solver.grid import Flow
from wake.solver.kernels import Domain, Pair, Spacing, advance_stage, compiled
from wake.solver.navier_stokes import A, B, FlowSolver, gusting, stage_ends


@compiled()
def _across(dy: Array, dyc: Array, nu: float) -> tuple[Array, Array]:
    """Return the stencils' coefficients in y: an array for u and an array for v. Coefficients of neighbours outside the
    domain are zero.

    The array for u, (4, ny + 2), has a column for each padded column of u: 1 / (2 dy), the diffusion coefficients to
    the north and to the south, and minus the sum of these coefficients. The array for v, (7, ny + 1), has a column for
    each column of v-faces: the averaging weights of the columns of u below and above the face, the diffusion
    coefficients to the north and to the south, minus the sum of these coefficients, 1 / (2 dyc), and 1 / dyc.
    """
    real, ny = dy.dtype.type, len(dy)
    one, half = real(1.0), real(0.5)
    u, v = np.zeros((4, ny + 2), dy.dtype), np.zeros((7, ny + 1), dy.dtype)
    for j in range(ny + 1):
        v[6, j] = one / dyc[j]
        v[5, j] = half * v[6, j]
    for j in range(ny):
        u[0, j + 1], u[1, j + 1], u[2, j + 1] = half / dy[j], nu / dy[j] * v[6, j + 1], nu / dy[j] * v[6, j]
        u[3, j + 1] = -(u[1, j + 1] + u[2, j + 1])
    for j in range(1, ny):
        v[0, j], v[1, j] = half * dy[j - 1] * v[6, j], half * dy[j] * v[6, j]
        v[2, j], v[3, j] = nu * v[6, j] / dy[j], nu * v[6, j] / dy[j - 1]
        v[4, j] = -(v[2, j] + v[3, j])
    return u, v


@compiled("contract")
def back_rates(bar: Flow, gained: Pair[Array], u: Array, v: Array, nu: float, spacing: Spacing) -> None:
    """Propagate sensitivities from du/dt and dv/dt (`gained`, zero on faces that are not open) to u, v and p. The loops
    run row by row in x, and collect for each entry of u, v and p its effects on all rates. Loops over the rates, with
    additions to the entries around each rate, would take twice the time. A loop uses at most eight arrays, because the
    compiler does not vectorise loops with more arrays."""
    gu, gv = gained.u, gained.v
    real, nx, ny = u.dtype.type, u.shape[0] - 2, u.shape[1] - 2
    half, nu = real(0.5), real(nu)
    dx, dxc = spacing.dx, spacing.dxc
    yu, yv = _across(spacing.dy, spacing.dyc, nu)
    hy, north, south, self_u = yu[0], yu[1], yu[2], yu[3][1:-1]
    below, above, nv, sv, self_v, hc, cy = yv[0], yv[1], yv[2], yv[3], yv[4][1:-1], yv[5], yv[6]
    south_upper, below_upper, sv_upper = south[2:], below[1:], sv[2:]
    # Rows 0 to 4, for each x-face i: 1 / dxc, the diffusion coefficients to the west and to the east, and the averaging
    # weights of the cells on these sides. Rows 5 to 7, for each cell: 1 / (2 dx) and both diffusion coefficients.
    # Entries after the last face or cell are zero; negative indices read these zeros, too.
    x = np.zeros((8, nx + 3), u.dtype)
    rdxc, west, east, left, right, hrx, west_v, east_v = x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7]
    for i in range(1, nx + 1):
        r = real(1.0) / dxc[i]
        rdxc[i], west[i], east[i] = r, nu / dx[i - 1] * r, nu / dx[i] * r
        left[i], right[i] = half * dx[i - 1] * r, half * dx[i] * r
    for i in range(nx):
        hrx[i], west_v[i], east_v[i] = half / dx[i], nu / dxc[i] / dx[i], nu / dxc[i + 1] / dx[i]
    rows = np.zeros((8, ny + 1), u.dtype)
    shares, shifts, through, crossing, part, inner = rows[0:2], rows[2:4], rows[4], rows[5], rows[6], rows[7]
    for i in range(nx + 2):
        # Neighbours beyond the first and the last row have zero coefficients, so any row may be read in their place;
        # index -1 reads the last entry.
        back, ahead = max(i - 1, 0), min(i + 1, nx + 1)
        g, ui, va, vb, ga, gb = gu[i], u[i], v[i], v[ahead], gv[i], gv[ahead]
        w0, w1, s0, s1 = shares[(i + 1) % 2], shares[i % 2], shifts[(i + 1) % 2], shifts[i % 2]
        for k in range(ny + 1):
            w1[k] = below[k] * ui[k] + above[k] * ui[k + 1]
        for k in range(ny + 1):
            s1[k] = (ui[k + 1] - ui[k]) * (hy[k] * g[k] + hy[k + 1] * g[k + 1])
        to_west, to_east, h0, h1 = left[i], right[i], hrx[i - 1], hrx[i]
        for k in range(ny + 1):
            through[k] = to_west * va[k] + to_east * vb[k]
        for k in range(ny + 1):
            crossing[k] = (h0 * ga[k] + h1 * gb[k]) * (vb[k] - va[k])
        bu = bar.u[i]
        bu[0] += g[1] * (south[1] + hy[1] * through[0])
        bu[ny + 1] += g[ny] * (north[ny] - hy[ny] * through[ny])
        both_u = west[i] + east[i]
        for k in range(ny):
            inner[k] = (
                g[k + 1] * (self_u[k] - both_u + hy[k + 1] * (through[k + 1] - through[k]))
                + g[k + 2] * (south_upper[k] + hy[k + 2] * through[k + 1])
                + g[k] * (north[k] - hy[k] * through[k])
            )
        dw, hw, de, he = west[i + 1], half * rdxc[i + 1], east[i - 1], half * rdxc[i - 1]
        um, bm, gm, gw, ge = ui[1:-1], bu[1:-1], g[1:-1], gu[back, 1:-1], gu[ahead, 1:-1]
        for k in range(ny):
            beside = ge[k] * (dw + hw * um[k]) + gw[k] * (de - he * um[k])
            bm[k] += inner[k] + beside - below_upper[k] * crossing[k + 1] - above[k] * crossing[k]
        if i <= nx:
            bp, r0, r1 = bar.p[i], rdxc[i], rdxc[i + 1]
            for k in range(ny):
                bp[k] += ge[k] * r1 - gm[k] * r0 + gb[k + 1] * cy[k + 1] - gb[k] * cy[k]
        bv = bar.v[i]
        bv[0] += ga[1] * (sv[1] + hc[1] * va[0])
        bv[ny] += ga[ny - 1] * (nv[ny - 1] - hc[ny - 1] * va[ny])
        vm, sums, w_before, w_after = va[1:-1], part[1:-1], w0[1:-1], w1[1:-1]
        both_v = west_v[i - 1] + east_v[i - 1]
        for k in range(ny - 1):
            sums[k] = (
                ga[k + 1] * (self_v[k] - both_v + h0 * (w_after[k] - w_before[k]))
                + ga[k] * (nv[k] - hc[k] * vm[k])
                + ga[k + 2] * (sv_upper[k] + hc[k + 2] * vm[k])
            )
        gw_v, dw_v, hw_v, de_v, he_v = gv[back], west_v[i], hrx[i], east_v[i - 2], hrx[i - 2]
        before, here = right[i - 1], left[i]
        for k in range(ny + 1):
            beside = gw_v[k] * (de_v - he_v * w0[k]) + gb[k] * (dw_v + hw_v * w1[k])
            bv[k] += part[k] + beside - before * s0[k] - here * s1[k]


@compiled()
def _back_ghosts(flat: Array, ghosts: GhostMap) -> None:
    target, start, source, weight = ghosts.target, ghosts.start, ghosts.source, ghosts.weight
    for k in range(target.shape[0]):
        bar = flat[target[k]]
        flat[target[k]] = 0.0
        for e in range(start[k], start[k + 1]):
            flat[source[e]] += weight[e] * bar


@compiled()
def back_walls(u: Array, v: Array, walls: Pair[GhostMap]) -> None:
    """Apply the transpose of `fill_walls`."""
    _back_ghosts(u.reshape(-1), walls.u)
    _back_ghosts(v.reshape(-1), walls.v)


@compiled()
def back_edges(u: Array, v: Array) -> None:
    """Apply the transpose of `fill_edges`."""
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


@compiled("contract")
def _back_step(q: Array, bar: Array, step: float, a: float, runs: Index, pad_i: int, pad_j: int) -> None:
    """Compute `q = a * q + step * bar` on the open faces: the sensitivities to a stage's rates. `step * bar` is the
    rates' effect through this stage's velocity, and `a * q` is their effect through the next stage's rates."""
    step, a = q.dtype.type(step), q.dtype.type(a)
    for r in range(runs.shape[0]):
        i, j0, j1 = runs[r, 0] + pad_i, runs[r, 1] + pad_j, runs[r, 2] + pad_j
        qi, bi = q[i, j0:j1], bar[i, j0:j1]
        for k in range(qi.shape[0]):
            qi[k] = a * qi[k] + step * bi[k]


@compiled()
def _back_stage(
    bar: Flow, slot_bar: Array, rates: Pair[Array], u: Array, v: Array, a_next: float, step: float, domain: Domain
) -> None:
    """Apply the transpose of a stage that began with velocity u, v. The next stage multiplies the rates by `a_next`."""
    runs, slot_rows, column = domain.runs, domain.slot_rows, domain.slot_column
    back_walls(bar.u, bar.v, domain.walls)
    back_edges(bar.u, bar.v)
    for m in range(len(slot_rows)):
        slot_bar[m] = bar.u[column, slot_rows[m] + 1]
        bar.u[column, slot_rows[m] + 1] = 0.0
    bar.u[0] = 0.0
    _back_step(rates.u, bar.u, step, a_next, runs.u, 0, 1)
    _back_step(rates.v, bar.v, step, a_next, runs.v, 1, 0)
    back_rates(bar, rates, u, v, domain.viscosity, domain.spacing)


@compiled()
def back_stages(
    bar: Flow,
    slot_bar: Array,
    start: Flow,
    work: Flow,
    rates: Pair[Array],
    second: Pair[Array],
    a: Array,
    step: Array,
    slot_velocity: Array,
    wind: Array,
    gained: Array,
    domain: Domain,
) -> None:
    """Apply the transpose of `wake.solver.kernels.stages` for its three stages. `bar` has the sensitivities after the
    stages, and is overwritten with those before them. `slot_bar` (3, m) receives the sensitivities to the velocities on
    the slots' m faces at each stage's end. `start` is the flow at the step's start; its copy `work` and the arrays
    `rates` and `second` with finite values are overwritten. The other arguments are as in the forward kernel."""
    # Each loop contains only one call, and no array is assigned to a slice: a second call or such an assignment would
    # double the time of compiling this function.
    for k in range(2):
        advance_stage(work, rates, a[k], step[k], slot_velocity[k], wind[k], gained[k], domain)
        for source, target in ((work.u, second.u), (work.v, second.v)):
            for i in range(source.shape[0] if k == 0 else 0):
                for j in range(source.shape[1]):
                    target[i, j] = source[i, j]
    # From here on the arrays of the rates hold the sensitivities to the rates.
    u, v, a_next = work.u, work.v, 0.0
    for k in range(2, -1, -1):
        _back_stage(bar, slot_bar[k], rates, u, v, a_next, step[k], domain)
        a_next = a[k]
        u, v = (second.u, second.v) if k == 2 else (start.u, start.v)


@compiled()
def back_divergence(bar_b: Array, u: Array, v: Array, dx: Array, dy: Array, runs: Index) -> None:
    """Apply the transpose of `divergence`."""
    for r in range(runs.shape[0]):
        i, j0, j1 = runs[r, 0], runs[r, 1], runs[r, 2]
        width, height, b = dx[i], dy[j0:j1], bar_b[i, j0:j1]
        uw, ue, vi = u[i, j0 + 1 : j1 + 1], u[i + 1, j0 + 1 : j1 + 1], v[i + 1, j0 : j1 + 1]
        for k in range(j1 - j0):
            ue[k] += b[k] * height[k]
            uw[k] -= b[k] * height[k]
        for k in range(j1 - j0):
            vi[k + 1] += b[k] * width
        for k in range(j1 - j0):
            vi[k] -= b[k] * width


@compiled()
def back_correct(bar: Flow, phi: Array, dt: float, dxc: Array, dyc: Array, runs: Pair[Index]) -> None:
    """Apply the transpose of `correct`; phi is overwritten with the sensitivities to phi."""
    one = phi.dtype.type(1.0)
    u, v, p, u_runs, v_runs = bar.u, bar.v, bar.p, runs.u, runs.v
    nx, ny = phi.shape
    for j in range(ny):
        p[nx - 1, j] -= p[nx, j]
        p[nx, j] = 0.0
    rdt = one / phi.dtype.type(dt)
    for i in range(nx):
        for j in range(ny):
            phi[i, j] = p[i, j] * rdt
    rdyc = one / dyc
    for r in range(v_runs.shape[0]):
        i, j0, j1 = v_runs[r, 0], v_runs[r, 1], v_runs[r, 2]
        vi, pi, c = v[i + 1, j0:j1], phi[i, j0 - 1 : j1], rdyc[j0:j1]
        for k in range(j1 - j0):
            pi[k + 1] -= vi[k] * c[k]
        for k in range(j1 - j0):
            pi[k] += vi[k] * c[k]
    rd = one / dxc[nx]
    for j in range(ny):
        phi[nx - 1, j] += u[nx, j + 1] * rd
    for r in range(u_runs.shape[0]):
        i, j0, j1 = u_runs[r, 0], u_runs[r, 1], u_runs[r, 2]
        if i == nx:
            continue
        rd = one / dxc[i]
        ui, pw, pe = u[i, j0 + 1 : j1 + 1], phi[i - 1, j0:j1], phi[i, j0:j1]
        for k in range(j1 - j0):
            pe[k] -= ui[k] * rd
            pw[k] += ui[k] * rd


class FlowAdjoint(CopiedWhole):
    """A backward integration of sensitivities over the runs of a `FlowSolver`, with the solver's present viscosity."""

    def __init__(self, solver: FlowSolver) -> None:
        self._solver = solver
        shape = solver.grid.shape
        self._work = Flow.zeros(shape, solver.precision)
        self._rates, self._second = (
            kernels.Pair(np.zeros_like(self._work.u), np.zeros_like(self._work.v)) for _ in range(2)
        )
        self._phi, self._b = np.zeros(shape, solver.precision), np.zeros(shape, solver.precision)

    def run(
        self,
        bar: Flow,
        starts: Array,
        *,
        dt: float,
        action_from: float,
        action_to: float,
        wind: Callable[[float], float] | None = None,
    ) -> tuple[float, float]:
        """Propagate sensitivities from a run's end to its beginning; `bar` is overwritten. `starts` (steps, size of the
        buffer) are the flows that `FlowSolver.run` stored; the other arguments are those with which it was called.
        Returns the sensitivities to `action_from` and `action_to`."""
        solver, domain, steps = self._solver, self._solver.domain, len(starts)
        slots = solver.slot_velocity(action_from, action_to, steps)
        slot_bar = np.zeros_like(slots)
        u, v, spacing, work = bar.u, bar.v, domain.spacing, self._work
        for step in range(steps - 1, -1, -1):
            start, (blown, gained) = Flow.of(starts[step], solver.grid.shape), gusting(wind, dt, step)
            back_walls(u, v, domain.walls)
            back_edges(u, v)
            back_correct(bar, self._phi, dt, solver.between, spacing.dyc, domain.runs)
            solver.poisson.solve_into(self._phi, self._b)
            back_divergence(self._b, u, v, spacing.dx, spacing.dy, solver.boundary.cell_runs)
            kernels.clear_walls(u, v, domain.walls)
            work.flat[:] = start.flat
            rates, stages = (self._rates, self._second), (A, dt * B, slots[step], blown, gained)
            back_stages(bar, slot_bar[step], start, work, *rates, *stages, domain)
        to_actions = slot_bar @ solver.slot_profile[domain.slot_rows]
        ramp = stage_ends(steps) / steps
        return float(np.sum((1.0 - ramp) * to_actions)), float(np.sum(ramp * to_actions))
