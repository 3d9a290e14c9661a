"""Each kernel's transpose by the dot product with its tangent: a central difference is exact for what is quadratic."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from contract.config.body import BodyConfig
from wake.solver import adjoint_kernels, boundary, kernels
from wake.solver.flow import Flow
from wake.solver.grid import box_grid
from wake.solver.navier_stokes import FlowSolver
from wake.truck.body import signed_distance, slot_profile

DT = 1e-3
Change = Callable[[Flow], None]


@pytest.fixture(scope="module")
def solver() -> FlowSolver:
    """Around a body with round corners, whose ghosts have many sources."""
    grid = box_grid(2.0, 0.4)
    distance = partial(signed_distance, body=BodyConfig(length=2.0, leading_edge_radius=0.3))
    return FlowSolver(grid, boundary.build(grid, distance), 0.01, slot_profile=slot_profile(grid))


def fields(flow: Flow) -> kernels.Fields:
    return kernels.Fields(u=flow.u, v=flow.v, p=flow.p)


def pairs(solver: FlowSolver) -> dict[str, tuple[Change, Callable[[Flow, Flow], None]]]:
    """By name: what changes a flow in place, and the transpose, which changes sensitivities about a flow."""
    domain, grid, cells = solver.domain, solver.grid, solver.boundary.cell_runs
    nu, spacing, runs = domain.viscosity, domain.spacing, domain.runs

    def rate(flow: Flow) -> None:
        old = Flow.of(flow.flat.copy(), grid.shape)
        kernels.u_rate(flow.u, 1.0, old.u, old.v, old.p, nu, spacing, runs.u)
        kernels.v_rate(flow.v, 1.0, old.u, old.v, old.p, nu, spacing, runs.v)

    def back_rate(bar: Flow, flow: Flow) -> None:
        gained = Flow.zeros(grid.shape)
        for mine, theirs, is_open in (
            (gained.faces_u, bar.faces_u, solver.boundary.open_u),
            (gained.faces_v, bar.faces_v, solver.boundary.open_v),
        ):
            mine[is_open] = theirs[is_open]
        adjoint_kernels.back_rates(fields(bar), kernels.Rates(u=gained.u, v=gained.v), flow.u, flow.v, nu, spacing)

    def project(flow: Flow) -> None:
        kernels.clear_walls(flow.u, flow.v, domain.walls)
        b = np.zeros(grid.shape)
        kernels.divergence(b, flow.u, flow.v, grid.dx, grid.dy, cells)
        kernels.correct(fields(flow), solver.poisson.solve(b), DT, grid.dxc, grid.dyc, runs)

    def back_project(bar: Flow, flow: Flow) -> None:
        phi = np.zeros(grid.shape)
        adjoint_kernels.back_correct(fields(bar), phi, DT, grid.dxc, grid.dyc, runs)
        adjoint_kernels.back_divergence(solver.poisson.solve(phi), bar.u, bar.v, grid.dx, grid.dy, cells)
        kernels.clear_walls(bar.u, bar.v, domain.walls)

    return {
        "walls": (
            lambda flow: kernels.fill_walls(flow.u, flow.v, domain.walls),
            lambda bar, flow: adjoint_kernels.back_walls(bar.u, bar.v, domain.walls),
        ),
        "edges": (
            lambda flow: kernels.fill_edges(flow.u, flow.v, domain.inflow.v),
            lambda bar, flow: adjoint_kernels.back_edges(bar.u, bar.v),
        ),
        "rates": (rate, back_rate),
        "projection": (project, back_project),
    }


@pytest.mark.slow  # numba compiles the adjoint
@pytest.mark.parametrize("name", ["walls", "edges", "rates", "projection"])
def test_the_transpose_of_a_kernel_gives_the_tangents_dot_product(solver, name):
    change, transpose = pairs(solver)[name]
    rng = np.random.default_rng(5)
    shape = solver.grid.shape
    flow, direction, bar = (Flow.of(rng.normal(size=Flow.zeros(shape).flat.size), shape) for _ in range(3))
    for each in (flow, direction, bar):
        # Neither the flow nor its sensitivities have a pressure in the body.
        each.cells_p[~solver.boundary.fluid] = 0.0
    ahead, behind = (Flow.of(flow.flat + sign * direction.flat, shape) for sign in (1.0, -1.0))
    change(ahead)
    change(behind)
    tangent = 0.5 * (ahead.flat - behind.flat)
    forwards = bar.flat @ tangent
    scale = np.linalg.norm(bar.flat) * np.linalg.norm(tangent)
    transpose(bar, flow)
    # Rounding alone, of sums of 60,000 products; the projection's solver has a condition number of some thousands.
    assert abs(bar.flat @ direction.flat - forwards) <= 1e-11 * scale
